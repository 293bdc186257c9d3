"""Against software of the robots' makers, which is not ours to pass on: `python benchmarks/foreign.py --help`.

Checkouts are given by path, and stay where they are. Makes benchmarks/results/foreign.md from what was run; rows are kept in
benchmarks/results/foreign.json, and what was not run stays as it stood. Real time wants two cores, or `chrt -r 4 python ...`.

    git clone https://github.com/unitreerobotics/unitree_mujoco; ... unitree_sdk2_python; ... unitree_legged_sdk
    python benchmarks/foreign.py dds unitree_mujoco unitree_sdk2_python PYTHON   # that has cyclonedds 0.10.2, mujoco, pygame
    unshare -n python benchmarks/foreign.py udp unitree_legged_sdk   # as root, with g++: in a network of its own
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

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):  # the other core is the simulator's
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
SCALE = 0.005  # how sure the scale is
A1_ADDRESS = "192.168.123.10"  # that its SDK speaks to
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
    """A link whose robot goes on by a control period with each command: however busy the computer is, nothing is late."""

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
        """The next sample; the link takes a world that waits for one that is silent."""
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
    """The simulator's Go2 in its scene, without the meshes, which its window needs; perhaps with something on its back."""
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
    """(10,) composite parameters of a scene's robot in its base's axes, by MuJoCo, as `components` has them."""
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
    """The public simulator in its own Python."""
    command = [given.python, str(PROGRAMS / "bridge.py"), given.mujoco, str(world), "--domain", str(DOMAIN), *flags]
    environment = {**os.environ, "PYTHONPATH": given.sdk2}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=environment)
    try:
        while '"ready"' not in process.stdout.readline():
            if process.poll() is not None:
                raise SystemExit(f"the simulator ended before it began: {' '.join(command)}")
        time.sleep(3.0)  # it falls on its belly
        yield process
    finally:
        process.kill()
        process.wait()


def calibrated(
    given: argparse.Namespace, how: str, step: float, surface: str, scale: float | None
) -> dict[str, object]:
    """A row: a calibration over the public simulator's bridge, and its errors."""
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
    """Calibrations over the public simulator's bridge, those that are not kept."""
    keys = ("how", "step", "surface", "scale")
    done = {tuple(row[key] for key in keys): row for row in kept}
    for planned in PLANNED:
        row = done[planned] = done.get(planned) or calibrated(given, *planned)
        print({key: value for key, value in row.items() if key not in ("truth", "sd")}, flush=True)
        yield list(done.values())


def udp(given: argparse.Namespace, _: list[dict[str, object]]) -> Generator[list[dict[str, object]]]:
    """Both directions over loopback, with programs that the makers' libraries are linked into."""
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
    """A program of ours, linked with a version of the SDK."""
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
    # Its LCM is not here, and not called.
    linking = [
        str(home / library),
        f"-Wl,-rpath,{(home / library).parent}",
        "-Wl,--unresolved-symbols=ignore-all",
        "-pthread",
    ]
    subprocess.run([*command, *linking, "-o", str(made)], check=True)
    return str(made)


def commanded(computer: str, protocol: str) -> dict[str, object]:
    """The maker's computer commands our simulated robot."""
    flags = ["--protocol", protocol, "--address", A1_ADDRESS, "--sim-preset", "ideal"]
    with subprocess.Popen(
        [sys.executable, "-m", "equipoise.lab.emulators.unitree_udp", *flags], stdout=subprocess.PIPE, text=True
    ) as robot:
        while '"ready"' not in robot.stdout.readline():
            pass
        told = said(
            subprocess.run([computer, A1_ADDRESS, "8007"], stdout=subprocess.PIPE, text=True, check=True).stdout
        )
        robot.terminate()
        log = [json.loads(line) for line in robot.stdout]
    read = next(line for line in log if "damaged" in line)
    return {**told, "read": read["received"], "damaged": read["damaged"], "published": read["sent"]}


def commanding(robot: str) -> dict[str, object]:
    """Our driver commands a robot that the maker's library makes."""
    model = load_robot("unitree_a1")
    with subprocess.Popen([robot, "8007", "3000"], stdout=subprocess.PIPE, text=True) as process:
        link = open_udp(model, UnitreeUdpSettings("a1", A1_ADDRESS, form="struct"))
        with HardwarePlatform(link) as platform:
            here = platform.read().joint_position
            for _ in range(1000):
                platform.step(JointCommand(here, kp=np.full(12, 40.0), kd=np.full(12, 2.0)))
        counts = link.counts
        told = said(process.stdout.read())
    return {**told, "samples": counts["good"], "position": here.tolist()[:3]}


def said(output: str) -> dict[str, object]:
    """The last line of JSON: the makers' libraries speak, too."""
    return json.loads([line for line in output.splitlines() if line.startswith("{")][-1])


def sources(given: argparse.Namespace) -> list[str]:
    """The checkouts that were run."""
    return [checkout(path) for name, path in vars(given).items() if name in ("mujoco", "sdk2", "legged")]


def page(found: dict[str, dict]) -> str:
    """The page of what was run; a part that was not is not on it."""
    return (
        "\n".join([HEAD, *(line for part, write in PARTS.items() if part in found for line in write(found[part]))])
        + "\n"
    )


def dds_section(part: dict) -> list[str]:
    lines = [
        "## A Go2 over DDS: unitree_mujoco's Python simulator and its bridge",
        "",
        f"{', '.join(part['of'])}; cyclonedds {VERSION} here, 0.10.2 there, as its SDK pins.",
        "",
        DDS_TEXT,
        "",
        "| world | step ms | `--surface` | scale | mass g | CoM x / y / z mm | Ixx / Iyy / Izz % | worst of 7 sd | "
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
        "| who commands | packets sent | read by the robot | damaged | answers the SDK took | gravity it read m/s2 |",
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
        "The other way round a program made of SDK 3.3.1 was the robot, as a server of its structures (730 and 891 bytes, "
        f"`form=struct`): of our driver's packets, 1000 of them commands, it took {driver['received']}, "
        f"and read a knee at {q:.1f} rad, "
        f"kp {kp:.0f}, kd {kd:.0f}, mode {driver['mode']}, level {driver['level']}, as they were sent; of its samples the "
        f"driver took {driver['samples']}, with checksums, and the knee at {driver['position'][2]:.1f} rad.",
    ]


HEAD = """# Against foreign software

`python benchmarks/foreign.py`, with checkouts of the makers' public repositories, of which nothing is here. No robot was
tried.
"""
DDS_TEXT = f"""The simulator runs as it is, in a Python of its own, without a window (`benchmarks/foreign_programs/bridge.py`).
The robot is the Go2 of its MJCF with {PAYLOAD[0]:g} kg on its back, and lies limp at first; its feet resist rolling.
`bayesian` is given the MJCF without the load, and a scale good to {100 * SCALE:g} %, or none. Errors are estimates less
MuJoCo's own sums over the loaded MJCF. In lockstep the world waits for commands. In real time it goes by its own clock, and
as its samples carry no time, they count as taken when they come."""
UDP_TEXT = """A program of ours that the maker's library is linked into (`benchmarks/foreign_programs/computer.cpp`) commands
our simulated robot for four seconds: it holds, then turns a knee. On loopback, in a network that has the A1's address."""
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
