"""Tests with software of robot manufacturers, which is not distributed here: `python benchmarks/foreign.py --help`.

Checkouts are passed by path. Rows are stored in benchmarks/results/foreign.json, where other parts stay unchanged.
benchmarks/results/foreign.md is written from the rows. Real time needs two cores, or `chrt -r 4 python ...`.

    git clone https://github.com/unitreerobotics/unitree_mujoco; ... unitree_sdk2_python; ... unitree_legged_sdk
    python benchmarks/foreign.py dds unitree_mujoco unitree_sdk2_python PYTHON   # that has cyclonedds 0.10.2, mujoco, pygame
    unshare -n python benchmarks/foreign.py udp unitree_legged_sdk   # as root, with g++, in a separate network namespace
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):  # the simulator uses the other core
    os.environ.setdefault(_name, "1")

import mujoco
import numpy as np
from provenance import checkout, commit, write_page

from equipoise import BayesianMethod, SteppedPlatform, calibrate, load_robot, nominal_stance
from equipoise.drivers.dds.cyclone import VERSION
from equipoise.drivers.hardware import HardwarePlatform
from equipoise.drivers.unitree.dds import open_connection
from equipoise.drivers.unitree.dds_settings import UnitreeDdsSettings
from equipoise.drivers.unitree.udp import open_connection as open_udp
from equipoise.drivers.unitree.udp_settings import UnitreeUdpSettings
from equipoise.errors import CommunicationError, EquipoiseError
from equipoise.guard.guard import Guard
from equipoise.guard.remote_robot import RemoteRobot
from equipoise.platform.platform import ACCEPTS_EVERYTHING, JointCommand

RESULTS = Path(__file__).parent / "results"
ROWS = RESULTS / "foreign.json"
PROGRAMS = Path(__file__).parent / "foreign_programs"
DOMAIN, PAYLOAD = 57, (1.0, (0.05, 0.02, 0.08))  # kg, m
SCALE = 0.005  # relative standard deviation of the scale
A1_ADDRESS = "192.168.123.10"  # address of the robot in its SDK
SDKS = {  # revision, library, flags
    "v3.3.1": ("v3.3.1", "lib/libunitree_legged_sdk_amd64.so", ()),
    "v3.8.6": ("HEAD", "lib/cpp/amd64/libunitree_legged_sdk.a", ("-DGO1",)),
}
WITHOUT_PRIORITY = "real time, no priority"
PLANNED = (
    ("lockstep", 0.002, "hard", SCALE),
    ("real time", 0.002, "hard", SCALE),
    (WITHOUT_PRIORITY, 0.002, "hard", SCALE),
    ("lockstep", 0.002, "carpet", SCALE),
    ("lockstep", 0.002, "hard", None),
    ("real time", 0.005, "hard", SCALE),
)
PATIENCE = 5.0  # [s] for a sample


class Lockstep(SteppedPlatform):
    """Connection in lockstep: the robot advances by a control period with each command, so that no command is late."""

    accepts = ACCEPTS_EVERYTHING

    def __init__(self, robot, link):
        super().__init__(robot)
        self.control_period, self._connection, self._newest = link.control_period, link, None

    def read(self):
        return self._newest or self._sense()

    def step(self, command):
        self._connection.send(command)
        return self._sense()

    def close(self):
        self._connection.release()
        self._connection.close()

    def _sense(self):
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
def bridge(given: argparse.Namespace, world: Path, *flags: str) -> Generator[subprocess.Popen[str]]:
    """Run the public simulator in its own Python."""
    command = [given.python, str(PROGRAMS / "bridge.py"), given.mujoco, str(world), "--domain", str(DOMAIN), *flags]
    environment = {**os.environ, "PYTHONPATH": given.sdk2}
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


def calibrated(
    given: argparse.Namespace, how: str, step: float, surface: str, scale: float | None
) -> dict[str, object]:
    """Return the row of a calibration over the public simulator's bridge."""
    robots = Path(given.mujoco) / "unitree_robots"
    with tempfile.TemporaryDirectory() as folder:
        own, loaded = (scene(robots, Path(folder) / name, bool(name == "loaded")) for name in ("own", "loaded"))
        robot = load_robot(str(own.parent / "go2.xml"))
        stance = nominal_stance(robot).joint_position
        truth = truth_of(loaded, dict(zip(robot.joint_names, stance.tolist(), strict=True)))
        row: dict[str, object] = {"how": how, "step": step, "surface": surface, "scale": scale, "commit": commit()}
        row["truth"] = truth.tolist()
        method = BayesianMethod(surface=surface)
        method = method.weighed(truth[0], scale * truth[0]) if scale else method
        lockstep = how == "lockstep"
        settings = UnitreeDdsSettings(
            "lo",
            DOMAIN,
            release_sport_mode=False,
            check_crc=False,
            silence=10.0 if lockstep else 0.5,
            accept_cyclonedds=VERSION,
        )
        with bridge(given, loaded, "--step", str(step), *(["--lockstep"] if lockstep else [])) as simulator:
            try:
                if lockstep:
                    moved = Guard(Lockstep(robot, open_connection(robot, settings)), robot)
                else:
                    moved = RemoteRobot("unitree-go2", robot, vars(settings), realtime=how != WITHOUT_PRIORITY)
                with moved:
                    result = calibrate(moved, robot, method)
            except EquipoiseError as error:
                return {**row, "failed": f"{type(error).__name__}: {error}", "alive": simulator.poll() is None}
            row["alive"] = simulator.poll() is None
    found = result.composite
    row["verdicts"] = [str(value.verdict) for value in (found.mass, *found.com_in_base, *found.inertia.moments)]
    row["robot_time"] = sum(trial.duration for trial in result.trials)
    return {
        **row,
        "error": (found.values - truth).tolist(),
        "sd": found.stds.tolist(),
        "warnings": list(result.warnings),
    }


def dds(given: argparse.Namespace, kept: list[dict[str, object]]) -> Generator[list[dict[str, object]]]:
    """Run the missing calibrations over the public simulator's bridge."""
    keys = ("how", "step", "surface", "scale")
    done = {tuple(row[key] for key in keys): row for row in kept}
    for planned in PLANNED:
        row = done[planned] = done.get(planned) or calibrated(given, *planned)
        print({key: value for key, value in row.items() if key not in ("truth", "sd")}, flush=True)
        yield list(done.values())


def udp(given: argparse.Namespace, _: list[dict[str, object]]) -> Generator[list[dict[str, object]]]:
    """Test both directions over loopback, with programs linked with the manufacturers' libraries."""
    for command in ("link set lo up", f"addr add {A1_ADDRESS}/32 dev lo"):
        subprocess.run(["ip", *command.split()], check=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rows = [
            {
                "what": f"{robot} by SDK {sdk}",
                "commit": commit(),
                **commanded(built(given, folder, sdk, "computer"), robot.lower()),
            }
            for robot, sdk in (("A1", "v3.3.1"), ("Go1", "v3.8.6"))
        ]
        rows.append({"what": "driver of A1, form struct", **commanding(built(given, folder, "v3.3.1", "robot"))})
    print(rows)
    yield rows


def built(given: argparse.Namespace, folder: Path, sdk: str, program: str) -> str:
    """Build one of our programs with a version of the SDK."""
    revision, library, flags = SDKS[sdk]
    home = folder / sdk
    home.mkdir(exist_ok=True)
    archive = subprocess.run(
        ["git", "-C", given.legged, "archive", revision, "include", library], capture_output=True, check=True
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


def commanded(computer: str, protocol: str) -> dict[str, object]:
    """Command our emulator with the manufacturer's SDK."""
    flags = ["--protocol", protocol, "--address", A1_ADDRESS, "--sim-preset", "ideal"]
    with subprocess.Popen(
        [sys.executable, "-m", "equipoise.lab.emulators.unitree_udp", *flags], stdout=subprocess.PIPE, text=True
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


def commanding(robot: str) -> dict[str, object]:
    """Command a robot built from the manufacturer's library with our driver."""
    model = load_robot("unitree_a1")
    with subprocess.Popen([robot, "8007", "3000"], stdout=subprocess.PIPE, text=True) as process:
        link = open_udp(model, UnitreeUdpSettings("a1", A1_ADDRESS, form="struct"))
        with HardwarePlatform(link) as platform:
            here = platform.read().joint_position
            for _ in range(1000):
                platform.step(JointCommand(here, kp=np.full(12, 40.0), kd=np.full(12, 2.0)))
        counts = link.counts
        output = last_json(process.stdout.read())
    return {**output, "samples": counts["good"], "position": here.tolist()[:3]}


def last_json(output: str) -> dict[str, object]:
    """Return the last line of JSON, because the manufacturers' libraries also print."""
    return json.loads([line for line in output.splitlines() if line.startswith("{")][-1])


def sources(given: argparse.Namespace) -> list[str]:
    """Return the commits of the checkouts."""
    return [checkout(path) for name, path in vars(given).items() if name in ("mujoco", "sdk2", "legged")]


def page(found: dict[str, dict]) -> str:
    """Return the page, with the parts that have rows."""
    return (
        "\n".join([HEAD, *(line for part, write in PARTS.items() if part in found for line in write(found[part]))])
        + "\n"
    )


def dds_section(part: dict) -> list[str]:
    lines = [
        "## A Go2 over DDS: unitree_mujoco's Python simulator and its bridge",
        "",
        f"{', '.join(part['of'])}; cyclonedds {VERSION} in equipoise, 0.10.2 in the simulator, as its SDK requires.",
        "",
        DDS_TEXT,
        "",
        "| world | step ms | `--surface` | scale | mass g | CoM x / y / z mm | Ixx / Iyy / Izz % | largest error / std of 7 | "
        "checks failed | simulator lives | commit |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in part["rows"]:
        head = f"| {row['how']} | {1e3 * row['step']:.0f} | {row['surface']} | {'yes' if row['scale'] else 'no'} | "
        alive = f"{'yes' if row['alive'] else 'no'} | {row['commit']} |"
        if "failed" in row:
            lines.append(head + f"{row['failed']} | | | | | {alive}")
            continue
        error, truth, sd = (np.array(row[key]) for key in ("error", "truth", "sd"))
        com = " / ".join(f"{1e3 * value:+.2f}" for value in error[1:4])
        moments = " / ".join(f"{value:+.1f}" for value in 100 * error[4:7] / truth[4:7])
        checks = ", ".join(warning.split(":")[0] for warning in row["warnings"]) or "none"
        worst = np.abs(error[:7] / sd[:7]).max()
        lines.append(head + f"{1e3 * error[0]:+.0f} | {com} | {moments} | {worst:.1f} | {checks} | {alive}")
    return [*lines, ""]


def udp_section(part: dict) -> list[str]:
    a1, go1, driver = part["rows"]
    lines = [
        "## An A1 and a Go1 over UDP: unitree_legged_sdk",
        "",
        f"{', '.join(part['of'])}, its tag v3.3.1 for the A1; equipoise at {a1['commit']}.",
        "",
        UDP_TEXT,
        "",
        "| commands from | packets sent | read by the robot | damaged | answers read by the SDK | gravity in them m/s2 |",
        "|---|---|---|---|---|---|",
    ]
    for row in (a1, go1):
        lines.append(
            f"| {row['what']} | {row['sent']} | {row['read']} | {row['damaged']} | {row['received']} | {row['up']:.2f} |"
        )
    q, kp, kd = driver["q"], driver["kp"], driver["kd"]
    return [
        *lines,
        "",
        "In the other direction, a program with SDK 3.3.1 was the robot and served its structures (730 and 891 bytes, "
        f"`form=struct`). It received {driver['received']} of our driver's packets, 1000 of them commands, "
        f"and read a knee at {q:.1f} rad, "
        f"kp {kp:.0f}, kd {kd:.0f}, mode {driver['mode']}, level {driver['level']}, as sent. The driver received "
        f"{driver['samples']} of its samples, with checksums, and the knee at {driver['position'][2]:.1f} rad.",
    ]


HEAD = """# Tests with software of robot manufacturers

`python benchmarks/foreign.py`, with checkouts of the manufacturers' public repositories, which are not distributed here. No
real robot was used.
"""
DDS_TEXT = f"""The unmodified simulator runs in its own Python without a window (`benchmarks/foreign_programs/bridge.py`).
The robot is the Go2 of its MJCF with {PAYLOAD[0]:g} kg on its back. It lies limp at first, and its feet have rolling friction.
`bayesian` uses the MJCF without the payload, with or without a scale with an error of {100 * SCALE:g} %. Errors are estimate
minus MuJoCo's sums over the loaded MJCF. In lockstep the simulation waits for commands. In real time it runs on its own clock;
its samples carry no time, so the time of their arrival is used."""
UDP_TEXT = """A program linked with the manufacturer's library (`benchmarks/foreign_programs/computer.cpp`) commands our
emulator for four seconds: it holds, then turns a knee. On loopback, in a network namespace with the A1's address."""
PARTS = {"dds": dds_section, "udp": udp_section}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parts = parser.add_subparsers(required=True)
    over_dds, over_udp = parts.add_parser("dds"), parts.add_parser("udp")
    for name in ("mujoco", "sdk2", "python"):
        over_dds.add_argument(name)
    over_udp.add_argument("legged")
    over_dds.set_defaults(part="dds", make=dds)
    over_udp.set_defaults(part="udp", make=udp)
    given = parser.parse_args()
    found = json.loads(ROWS.read_text(encoding="utf-8")) if ROWS.exists() else {}
    for rows in given.make(given, found.get(given.part, {}).get("rows", [])):
        found[given.part] = {"of": sources(given), "rows": rows}
        ROWS.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    write_page("foreign.md", page(found), (row for part in found.values() for row in part["rows"] if "commit" in row))


if __name__ == "__main__":
    main()
