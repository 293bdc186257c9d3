"""Tables of the page `safety`: timing of the control loop, and calibrations over the manufacturers' protocols with emulators.

Everything runs in real time and needs two idle cores; on a busy machine, `chrt -r 4 python benchmarks/safety.py`.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field

from rows import Row, Table  # isort: skip - it limits the threads of NumPy
import numpy as np
from emulated import GO2, GO2_DOMAIN, ROBOT, emulator, oscillate, standing_go2
from simulated import SCALE_ERROR, cases_of, judged, robot_called, weighed
from tables import column, coverage, failed_checks, figures, markdown, relative

from equipoise import BayesianMethod, calibrate, nominal_stance, simulate
from equipoise.experiments.stand import move_to, stand_up
from equipoise.guard.remote_robot import RemoteRobot

LOAD = 8  # busy processes
LOOPS = ((True, 0, 60), (False, 0, 60), (False, LOAD, 60), (True, LOAD, 600))
"""Real-time priority, busy processes, and seconds of each measurement of the loop."""
MOST_LATE, LEAST_ON_TIME, MOST_WORK = (
    5e-3,
    0.999,
    0.15e-3,
)  # [s], share within 1 ms, [s] of CPU time in a control period
SLEEPER = """
import json, sys, time
from equipoise.platform.realtime import claim_real_time
claimed, period, late = claim_real_time(), 2e-3, []
due = time.monotonic()
for _ in range(round(float(sys.argv[1]) / period)):
    due += period
    time.sleep(max(0.0, due - time.monotonic()))
    late.append(time.monotonic() - due)
    due += max(0.0, late[-1] // period * period)
late.sort()
print(json.dumps({"realtime": claimed, "commands": len(late), "overruns": sum(each > 1e-3 for each in late),
                  "late_999": late[len(late) * 999 // 1000], "latest": late[-1]}))
"""
DURATION, PAYLOAD = 60.0, "1,0.05,0.02,0.08"  # [s]; kg, m
SEEDS = 2
DOMAIN, ADDRESS, PORT, OURS = 41, "127.0.0.1", 48007, 48008
FAULTS = ("--loss", "0.02", "--duplicate", "0.02", "--reorder", "0.02")
GAINS, BY_JOINT = "quadruped_ros2_control", "/{joint}_controller/commands"


@dataclass(frozen=True)
class Wire:
    """Platform, emulator and its flags, and settings of the connection."""

    platform: str
    emulator: str
    flags: tuple[str, ...]
    settings: dict[str, object] = field(default_factory=dict)


def udp(protocol: str) -> Wire:
    settings = {"address": ADDRESS, "port": PORT, "local_port": OURS}
    return Wire(f"unitree-{protocol}", "unitree-udp", ("--protocol", protocol, "--port", str(PORT), *FAULTS), settings)


def ros2(*flags: str, **settings: object) -> Wire:
    return Wire("ros2", "ros2", ("--domain", str(DOMAIN), *flags), {"domain": DOMAIN, **settings})


WIRES = {
    "none: the same robot in this process": None,
    "Go2, DDS": Wire("unitree-go2", "unitree-dds", ("--domain", str(GO2_DOMAIN)), GO2),
    "A1, UDP": udp("a1"),
    "Go1, UDP": udp("go1"),
    "ROS 2, 100 Nm/rad, stiffness given": ros2("--stiffness", "100", stiffness=100.0),
    "ROS 2, 100 Nm/rad, stiffness not given": ros2("--stiffness", "100"),
    "ROS 2, 1000 Nm/rad": ros2("--stiffness", "1000"),
    "ROS 2, 1000 Nm/rad, no efforts": ros2("--stiffness", "1000", "--unreported", "effort"),
    "ROS 2, 1000 Nm/rad, trajectories at 100 Hz": ros2(
        "--stiffness", "1000", "--interpolate-from-desired-state", command_type="joint_trajectory", time_from_start=0.01
    ),
    "ROS 2, gains, a controller per interface": ros2("--stack", GAINS, stack=GAINS),
    "ROS 2, gains, a controller per joint": ros2(
        "--stack", GAINS, "--impedance-topic", BY_JOINT, stack=GAINS, command_topic=BY_JOINT
    ),
    "ROS 2, champ": ros2("--stack", "champ", stack="champ"),
    "ROS 2, champ, IMU at 250 Hz": ros2("--stack", "champ", "--imu-rate", "250", stack="champ"),
    "ROS 2, unitree-go2-ros2": ros2("--stack", "unitree-go2-ros2", stack="unitree-go2-ros2"),
}
"""Connections by name."""


@contextmanager
def busy(count: int) -> Generator[None]:
    """Run processes that keep the processors busy."""
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def loop(realtime: bool, load: int, seconds: float) -> Row:
    """Measure the lateness of commands during excitation and holding, and CPU time of both processes."""
    robot = robot_called(ROBOT)
    with standing_go2(), busy(load):
        remote = RemoteRobot("unitree-go2", robot, GO2, realtime=realtime)
        began, used = time.monotonic(), resource.getrusage(resource.RUSAGE_SELF)
        with remote:
            standing, feet = stand_up(remote, robot, nominal_stance(robot))
            oscillate(remote, seconds)
            move_to(standing, feet)
        now, wall = resource.getrusage(resource.RUSAGE_SELF), time.monotonic() - began
    share = (now.ru_utime + now.ru_stime - used.ru_utime - used.ru_stime) / wall
    return {**asdict(remote.report()), "calibration_share": share}


def sleeper(load: int, seconds: float) -> Row:
    """Measure the lateness of a process with real-time priority that only sleeps, and the time the hypervisor withheld."""
    with busy(load):
        stolen = stolen_time()
        done = subprocess.run([sys.executable, "-c", SLEEPER, str(seconds)], check=True, capture_output=True, text=True)
        return {**json.loads(done.stdout), "stolen": stolen_time() - stolen}


def stolen_time() -> float:
    """Return the time that this virtual machine wanted to run and did not, in all its processors since its start [s]."""
    with open("/proc/stat", encoding="utf-8") as file:
        return int(file.readline().split()[8]) / os.sysconf("SC_CLK_TCK")


def show_loop(rows: list[Row]) -> Iterator[str]:
    yield "## Timing of the control loop"
    yield ""
    yield (
        "An emulator sends a Go2's messages over DDS on loopback at 500 Hz. Delay of every command after its deadline, "
        f"during excitation and holding. Targets with real-time priority and {LOAD} busy processes in ten minutes: "
        f"{LEAST_ON_TIME:.1%} within 1 ms, none later than {1e3 * MOST_LATE:g} ms; CPU time of a control period at most "
        f"{1e3 * MOST_WORK:g} ms. Calibration process: its share of a core."
    )
    yield ""
    head = (
        "real-time priority", "busy processes", "commands", "within 1 ms", "99.9 % [ms]", "latest [ms]",
        "deadlines without command", "CPU time per period [ms]", "calibration process",
    )  # fmt: skip
    yield from markdown(head, map(_loop_line, rows))


def _loop_line(row: Row) -> list[str]:
    judged_here = row["case"][0] and row["case"][1] > 0
    on_time = 1 - row["overruns"] / row["commands"]
    share = f"**{on_time:.3%}**" if judged_here and on_time < LEAST_ON_TIME else f"{on_time:.3%}"
    return [
        row["realtime"], row["case"][1], row["commands"], share, figures(1e3 * row["late_999"]),
        figures(1e3 * row["latest"], most=1e3 * MOST_LATE if judged_here else np.inf), row["stalls"],
        figures(1e3 * row["work"], ".3f", 1e3 * MOST_WORK if judged_here else np.inf), f"{row['calibration_share']:.0%}",
    ]  # fmt: skip


def show_sleeper(rows: list[Row]) -> Iterator[str]:
    for row in rows:
        yield (
            f"The same computer: a process that only sleeps for 2 ms at a time, with {row['realtime']}, and "
            f"{row['case'][0]} busy processes: {1 - row['overruns'] / row['commands']:.3%} of {row['commands']} periods "
            f"within 1 ms, latest {1e3 * row['latest']:.1f} ms. Meanwhile the hypervisor withheld {row['stolen']:.2f} s of "
            "processor time."
        )


def calibrated(name: str, seed: int) -> Row:
    """Return the row of a calibration over a connection, or of the same robot in this process."""
    robot, wire = robot_called(ROBOT), WIRES[name]
    with simulate(robot, "realistic", PAYLOAD, seed) as simulation:
        truth = simulation.truth
        mass = weighed(truth.composite.mass, np.random.default_rng([seed, 77]))
        method = BayesianMethod(duration=DURATION, mass=mass, mass_std=SCALE_ERROR * mass)
        if wire is None:
            return judged(calibrate(simulation.platform, robot, method).with_truth(truth))
    flags = ("--sim-preset", "realistic", "--payload", PAYLOAD, "--seed", seed)
    with emulator(wire.emulator, *flags, *wire.flags):
        with RemoteRobot(wire.platform, robot, wire.settings) as remote:
            result = calibrate(remote, robot, method).with_truth(truth)
        report = remote.report()
    late = {"overruns": (report.overruns or 0) / report.commands, "latest": report.latest, "realtime": report.realtime}
    return judged(result) | late


def show_calibrated(rows: list[Row]) -> Iterator[str]:
    priority = sorted({row["realtime"] for row in rows if "realtime" in row})
    yield "## Calibrations over the manufacturers' protocols"
    yield ""
    yield (
        f"`bayesian` of {DURATION:g} s on an emulated A1, `realistic`, 1 kg of payload, a scale with an error of "
        f"{SCALE_ERROR:.1%}; the largest error of the runs. The emulator is a process of its own on loopback; no real robot "
        "was used. UDP: 2 % of packets are lost, 2 % doubled, 2 % overtaken. ROS 2: JointState, Imu and commands over DDS; "
        "champ's own IMU has 50 Hz. Late: share of commands more than 1 ms late (each of 100 trajectories per second waits "
        f"for ten samples), and the latest. Real-time priority: {', '.join(priority)}."
    )
    yield ""
    head = (
        "connection", "runs", "CoM x, y, z [mm]", "Ixx, Iyy, Izz [%]", "largest error / std", "coverage", "late [%]",
        "latest [ms]", "failed checks",
    )  # fmt: skip
    yield from markdown(head, _wire_lines(rows))


def _wire_lines(rows: list[Row]) -> Iterator[list[str]]:
    for name, wire in WIRES.items():
        if of := [row for row in rows if row["case"][0] == name]:
            error, ratio = np.abs(relative(of)).max(axis=0), np.abs(column(of, "error") / column(of, "sd")).max()
            late = ["-", "-"]
            if wire is not None:
                worst = column(of, "overruns").max(), column(of, "latest").max()
                late = [figures(100 * worst[0], ".1f"), figures(1e3 * worst[1], ".1f")]
            yield [
                name, str(len(of)), figures(error[1:4]), figures(error[4:7], ".1f"), figures(ratio, ".1f"), coverage(of),
                *late, failed_checks(of),
            ]  # fmt: skip


TABLES = (
    Table("loop", loop, LOOPS, show_loop, alone=True),
    Table("sleeper", sleeper, [(LOAD, 120)], show_sleeper, alone=True),
    Table(
        "wires",
        calibrated,
        cases_of({(name,): SEEDS for name in WIRES}),
        show_calibrated,
        alone=True,
    ),
)
