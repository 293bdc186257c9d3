"""Tables of the page `safety`: tests with software of robot manufacturers, which is not distributed here.

Environment variables name the checkouts; without them the rows that exist are kept. Real time needs two idle cores.

    git clone https://github.com/unitreerobotics/unitree_mujoco; ... unitree_sdk2_python; ... unitree_legged_sdk
    export UNITREE_MUJOCO=... UNITREE_SDK2_PYTHON=... UNITREE_PYTHON=...   # a Python with cyclonedds 0.10.2, mujoco, pygame
    export UNITREE_LEGGED_SDK=...
    python benchmarks/safety.py --only unitree_mujoco
    unshare -n python benchmarks/safety.py --only unitree_legged_sdk   # as root, with g++, in a separate network namespace
"""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

from rows import NotTriedError, Row, Table  # isort: skip - it limits the threads of NumPy
import mujoco
import numpy as np
from provenance import checkout
from simulated import SCALE_ERROR, robot_called
from tables import markdown, relative

from equipoise import BayesianMethod, RobotModel, RobotState, SteppedPlatform, calibrate, load_robot, nominal_stance
from equipoise.drivers.hardware import HardwarePlatform, RobotConnection
from equipoise.drivers.unitree.dds_settings import UnitreeDdsSettings
from equipoise.drivers.unitree.udp import open_connection as open_udp
from equipoise.drivers.unitree.udp_settings import UnitreeUdpSettings
from equipoise.errors import CommunicationError
from equipoise.guard.guard import Guard
from equipoise.guard.remote_robot import RemoteRobot
from equipoise.platform.platform import ACCEPTS_EVERYTHING, JointCommand

PROGRAMS = Path(__file__).parent / "foreign_programs"
DOMAIN, PAYLOAD = 57, (1.0, (0.05, 0.02, 0.08))  # kg, m
A1_ADDRESS = "192.168.123.10"  # address of the robot in its SDK
SDKS = {  # revision, library, flags
    "v3.3.1": ("v3.3.1", "lib/libunitree_legged_sdk_amd64.so", ()),
    "v3.8.6": ("HEAD", "lib/cpp/amd64/libunitree_legged_sdk.a", ("-DGO1",)),
}
CALIBRATIONS = (
    ("lockstep", 0.002, "hard", True),
    ("real time", 0.002, "hard", True),
    ("real time, no priority", 0.002, "hard", True),
    ("lockstep", 0.002, "carpet", True),
    ("lockstep", 0.002, "hard", False),
    ("real time", 0.005, "hard", True),
)
"""Clock, time step [s], `--surface`, and whether there is a scale."""
PATIENCE = 5.0  # [s] for a sample


def given(name: str) -> Path:
    """Return the path in an environment variable; raise `NotTriedError` without it."""
    if name not in os.environ:
        raise NotTriedError(f"the environment variable {name} is not set; see benchmarks/foreign.py")
    return Path(os.environ[name])


class Lockstep(SteppedPlatform):
    """Connection in lockstep: the robot advances by a control period with each command, so that no command is late."""

    accepts = ACCEPTS_EVERYTHING

    def __init__(self, robot: RobotModel, connection: RobotConnection) -> None:
        super().__init__(robot)
        self.control_period, self._connection, self._newest = connection.control_period, connection, None

    def read(self) -> RobotState:
        return self._newest or self._sense()

    def step(self, command: JointCommand) -> RobotState:
        self._connection.send(command)
        return self._sense()

    def close(self) -> None:
        self._connection.release()
        self._connection.close()

    def _sense(self) -> RobotState:
        """Return the next sample, and ignore errors of the connection, for which a waiting simulation is silent."""
        until = time.monotonic() + PATIENCE
        while True:
            try:
                if states := self._connection.receive():
                    self._newest = replace(states[-1], received=None)
                    return self._newest
            except CommunicationError:
                if time.monotonic() > until:
                    raise
            time.sleep(1e-4)


def scene(robots: Path, folder: Path, payload: bool) -> Path:
    """Return the simulator's scene of the Go2 without meshes, with or without a payload."""
    tree = ElementTree.parse(robots / "go2" / "go2.xml")
    root = tree.getroot()
    for parent in root.iter():
        for child in [each for each in parent if each.tag == "mesh" or "mesh" in each.attrib]:
            parent.remove(child)
    if payload:
        mass, place = PAYLOAD
        base = root.find("worldbody/body")
        load = ElementTree.SubElement(base, "body", name="payload", pos=" ".join(map(str, place)))
        ElementTree.SubElement(load, "inertial", pos="0 0 0", mass=str(mass), diaginertia="0.001 0.001 0.001")
    folder.mkdir(exist_ok=True)
    tree.write(folder / "go2.xml")
    return Path(shutil.copy(robots / "go2" / "scene.xml", folder))


def truth_of(path: Path, joints: dict[str, float]) -> np.ndarray:
    """Return the (10,) composite parameters of a scene's robot in base axes from MuJoCo, in the order of `components`."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
    for name, angle in joints.items():
        data.joint(name).qpos = angle
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    com, inertia = data.body("base_link").subtree_com, np.zeros((3, 3))
    for body in range(1, model.nbody):
        axes, away = data.ximat[body].reshape(3, 3), data.xipos[body] - com
        inertia += axes @ np.diag(model.body_inertia[body]) @ axes.T
        inertia += model.body_mass[body] * (away @ away * np.eye(3) - np.outer(away, away))
    off_diagonal = inertia[0, 1], inertia[0, 2], inertia[1, 2]
    return np.array([model.body_mass.sum(), *com, *inertia.diagonal(), *off_diagonal])


@contextmanager
def bridge(world: Path, *flags: str) -> Generator[subprocess.Popen[str]]:
    """Run the public simulator in its own Python."""
    python, simulator = given("UNITREE_PYTHON"), given("UNITREE_MUJOCO")
    command = [str(python), str(PROGRAMS / "bridge.py"), str(simulator), str(world), "--domain", str(DOMAIN), *flags]
    environment = {**os.environ, "PYTHONPATH": str(given("UNITREE_SDK2_PYTHON"))}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=environment)
    try:
        while '"ready"' not in process.stdout.readline():
            if process.poll() is not None:
                raise SystemExit(f"the simulator ended at its start: {' '.join(command)}")
        time.sleep(3.0)  # it falls on its belly
        yield process
    finally:
        process.kill()
        process.wait()


def calibrated(clock: str, step: float, surface: str, weighed: bool) -> Row:
    """Return the row of a calibration over the public simulator's bridge."""
    simulator, sdk = given("UNITREE_MUJOCO"), given("UNITREE_SDK2_PYTHON")
    from equipoise.drivers.dds.cyclone import VERSION  # noqa: PLC0415 - an extra
    from equipoise.drivers.unitree.dds import open_connection  # noqa: PLC0415

    lockstep = clock == "lockstep"
    with tempfile.TemporaryDirectory() as folder:
        own, loaded = (
            scene(simulator / "unitree_robots", Path(folder, name), name == "loaded") for name in ("own", "loaded")
        )
        robot = load_robot(str(own.parent / "go2.xml"))
        stance = nominal_stance(robot).joint_position
        truth = truth_of(loaded, dict(zip(robot.joint_names, stance.tolist(), strict=True)))
        method = BayesianMethod(surface=surface)
        method = method.weighed(truth[0], SCALE_ERROR * truth[0]) if weighed else method
        settings = UnitreeDdsSettings(
            "lo",
            DOMAIN,
            release_sport_mode=False,
            check_crc=False,
            silence=10.0 if lockstep else 0.5,
            accept_cyclonedds=VERSION,
        )
        with bridge(loaded, "--step", str(step), *(["--lockstep"] if lockstep else [])) as process:
            if lockstep:
                moved = Guard(Lockstep(robot, open_connection(robot, settings)), robot)
            else:
                moved = RemoteRobot("unitree-go2", robot, vars(settings), realtime="no priority" not in clock)
            with moved:
                result = calibrate(moved, robot, method)
            alive = process.poll() is None
    return {
        "of": [checkout(simulator), checkout(sdk)],
        "cyclonedds": VERSION,
        "truth": truth.tolist(),
        "error": (result.composite.values - truth).tolist(),
        "sd": result.composite.stds.tolist(),
        "alarms": [check.name for check in result.checks if not check.passed],
        "alive": alive,
    }


def show_calibrated(rows: list[Row]) -> Iterator[str]:
    yield "## Unitree's own software"
    yield ""
    yield (
        "Checkouts of the manufacturer's public repositories; no real robot was used. A Go2 over DDS: the unmodified Python "
        f"simulator of {', '.join(rows[0]['of'])}, with cyclonedds {rows[0]['cyclonedds']} in equipoise and 0.10.2 in the "
        f"simulator, without a window. The robot is the Go2 of its MJCF with {PAYLOAD[0]:g} kg on its back. It lies limp at "
        "first, and its feet have rolling friction. `bayesian` uses the MJCF without the payload, with or without a scale "
        f"with an error of {SCALE_ERROR:.1%}. In lockstep the simulation waits for commands. In real time its samples carry "
        "no time, so the time of their arrival is used."
    )
    yield ""
    head = (
        "clock", "step [ms]", "`--surface`", "scale", "mass [%]", "CoM x, y, z [mm]", "Ixx, Iyy, Izz [%]",
        "largest error / std", "failed checks", "simulator lives",
    )  # fmt: skip
    yield from markdown(head, map(_line, rows))


def _line(row: Row) -> list[str]:
    clock, step, surface, weighed = row["case"]
    error = relative([row])[0]
    ratio = np.abs(np.array(row["error"]) / row["sd"]).max()
    return [
        clock, f"{1e3 * step:g}", surface, "yes" if weighed else "no", f"{error[0]:+.2f}",
        " ".join(f"{value:+.2f}" for value in error[1:4]), " ".join(f"{value:+.1f}" for value in error[4:7]), f"{ratio:.1f}",
        ", ".join(row["alarms"]) or "none", "yes" if row["alive"] else "no",
    ]  # fmt: skip


def packets(robot: str, sdk: str) -> Row:
    """Test packets over loopback with a program that is linked with the manufacturer's library."""
    home = given("UNITREE_LEGGED_SDK")
    if len(socket.if_nameindex()) > 1:
        raise NotTriedError("the computer's own network is in use: run this with `unshare -n`")
    for command in ("link set lo up", f"addr replace {A1_ADDRESS}/32 dev lo"):
        subprocess.run(["ip", *command.split()], check=True)
    with tempfile.TemporaryDirectory() as name:
        if robot == "driver":
            row = commanding(built(home, Path(name), sdk, "robot"))
        else:
            row = commanded(built(home, Path(name), sdk, "computer"), robot.lower())
    return {"of": checkout(home), **row}


def built(checkout_of_sdk: Path, folder: Path, sdk: str, program: str) -> str:
    """Build one of our programs with a version of the SDK."""
    revision, library, flags = SDKS[sdk]
    home = folder / sdk
    home.mkdir(exist_ok=True)
    archive = subprocess.run(
        ["git", "-C", str(checkout_of_sdk), "archive", revision, "include", library], capture_output=True, check=True
    )
    subprocess.run(["tar", "x", "-C", str(home)], input=archive.stdout, check=True)
    headers, made = home / "include", home / program
    command = [
        "g++",
        "-std=c++14",
        *flags,
        f"-I{headers}",
        f"-I{headers / 'unitree_legged_sdk'}",
        str(PROGRAMS / f"{program}.cpp"),
    ]
    # LCM is neither installed nor called.
    linking = [
        str(home / library),
        f"-Wl,-rpath,{(home / library).parent}",
        "-Wl,--unresolved-symbols=ignore-all",
        "-pthread",
    ]
    subprocess.run([*command, *linking, "-o", str(made)], check=True)
    return str(made)


def commanded(computer: str, protocol: str) -> Row:
    """Command our emulator with the manufacturer's SDK."""
    flags = ["--protocol", protocol, "--address", A1_ADDRESS, "--sim-preset", "ideal"]
    with subprocess.Popen(
        [sys.executable, "-m", "equipoise", "lab", "emulate", "unitree-udp", *flags], stdout=subprocess.PIPE, text=True
    ) as robot:
        while '"ready"' not in robot.stdout.readline():
            pass
        output = last_json(
            subprocess.run([computer, A1_ADDRESS, "8007"], stdout=subprocess.PIPE, text=True, check=True).stdout
        )
        robot.terminate()
        log = [json.loads(line) for line in robot.stdout]
    read = next(line for line in log if "damaged" in line)
    return {**output, "read": read["received"], "damaged": read["damaged"], "published": read["sent"]}


def commanding(robot: str) -> Row:
    """Command a robot built from the manufacturer's library with our driver."""
    model = robot_called("unitree_a1")
    with subprocess.Popen([robot, "8007", "3000"], stdout=subprocess.PIPE, text=True) as process:
        connection = open_udp(model, UnitreeUdpSettings("a1", A1_ADDRESS, form="struct"))
        with HardwarePlatform(connection) as platform:
            here = platform.read().joint_position
            for _ in range(1000):
                platform.step(JointCommand(here, kp=np.full(12, 40.0), kd=np.full(12, 2.0)))
        counts = connection.counts
        output = last_json(process.stdout.read())
    return {**output, "samples": counts["good"], "position": here.tolist()[:3]}


def last_json(output: str) -> Row:
    """Return the last line of JSON, because the manufacturers' libraries also print."""
    return json.loads([line for line in output.splitlines() if line.startswith("{")][-1])


def show_packets(rows: list[Row]) -> Iterator[str]:
    yield (
        f"An A1 and a Go1 over UDP: programs linked with {rows[0]['of']} (`benchmarks/foreign_programs`), its tag v3.3.1 for "
        "the A1. One commands our emulator for four seconds: it holds, then turns a knee. On loopback, in a network "
        "namespace with the A1's address."
    )
    yield ""
    head = (
        "commands from",
        "packets sent",
        "read by the robot",
        "damaged",
        "answers read by the SDK",
        "gravity in them [m/s2]",
    )
    names = ("sent", "read", "damaged", "received")
    computers = [row for row in rows if "read" in row]
    lines = [
        [f"{row['case'][0]}, SDK {row['case'][1]}", *(row[name] for name in names), f"{row['up']:.2f}"]
        for row in computers
    ]
    yield from markdown(head, lines)
    for row in rows:
        if "samples" in row:
            yield ""
            yield (
                "In the other direction, a program with SDK 3.3.1 was the robot and served its structures (730 and 891 "
                f"bytes, `form=struct`). It received {row['received']} of our driver's packets, 1000 of them commands, and "
                f"read a knee at {row['q']:.1f} rad, kp {row['kp']:.0f}, kd {row['kd']:.0f}, mode {row['mode']}, level "
                f"{row['level']}, as sent. The driver received {row['samples']} of its samples, with checksums, and the knee "
                f"at {row['position'][2]:.1f} rad."
            )


TABLES = (
    Table("unitree_mujoco", calibrated, CALIBRATIONS, show_calibrated, alone=True),
    Table(
        "unitree_legged_sdk",
        packets,
        (("A1", "v3.3.1"), ("Go1", "v3.8.6"), ("driver", "v3.3.1")),
        show_packets,
        alone=True,
    ),
)
