"""Against software of the robots' makers, which is not ours to pass on: `python benchmarks/foreign.py --help`.

Checkouts are given by path, and stay where they are. Makes benchmarks/results/foreign.md from what was run, and leaves what
was not run as it stood: rows are kept in benchmarks/results/foreign.json. Real time wants two cores, or `chrt -r 4 python ...`.

    git clone https://github.com/unitreerobotics/unitree_mujoco; ... unitree_sdk2_python; ... unitree_legged_sdk
    python benchmarks/foreign.py dds unitree_mujoco unitree_sdk2_python PYTHON   # that has cyclonedds 0.10.2, mujoco, pygame
    python benchmarks/foreign.py udp unitree_legged_sdk                          # with g++ and unshare
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
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
from commit import commit

from equipoise import Precise, SteppedPlatform, calibrate, load_robot, nominal_stance
from equipoise.drivers.dds.cyclone import VERSION
from equipoise.drivers.hardware import HardwarePlatform
from equipoise.drivers.unitree.dds import open_link
from equipoise.drivers.unitree.dds_settings import UnitreeDdsSettings
from equipoise.errors import CommunicationError, EquipoiseError
from equipoise.guard.guard import Guard
from equipoise.platform.platform import ACCEPTS_EVERYTHING

RESULTS = Path(__file__).parent / "results"
ROWS = RESULTS / "foreign.json"
PROGRAMS = Path(__file__).parent / "foreign_programs"
DOMAIN, PAYLOAD = 57, (1.0, (0.05, 0.02, 0.08))  # kg, m
SCALE = 0.005  # how sure the scale is
PLANNED = (
    ("lockstep", 0.002, "hard"),
    ("real time", 0.002, "hard"),
    ("lockstep", 0.002, "carpet"),
    ("real time", 0.005, "hard"),
)
PATIENCE = 5.0  # [s] for a sample


class Lockstep(SteppedPlatform):
    """A link whose robot goes on by a control period with each command: however busy the computer is, nothing is late."""

    accepts = ACCEPTS_EVERYTHING

    def __init__(self, robot, link):
        super().__init__(robot)
        self.control_period, self._link, self._newest = link.control_period, link, None

    def read(self):
        return self._newest or self._sense()

    def step(self, command):
        self._link.send(command)
        return self._sense()

    def close(self):
        self._link.release()
        self._link.close()

    def _sense(self):
        """The next sample; the link takes a world that waits for one that is silent."""
        until = time.monotonic() + PATIENCE
        while True:
            try:
                if states := self._link.receive():
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


def calibrated(given: argparse.Namespace, how: str, step: float, surface: str) -> dict[str, object]:
    """A row: a calibration over the public simulator's bridge, and its errors."""
    robots = Path(given.mujoco) / "unitree_robots"
    with tempfile.TemporaryDirectory() as folder:
        own, loaded = (scene(robots, Path(folder) / name, bool(name == "loaded")) for name in ("own", "loaded"))
        robot = load_robot(str(own.parent / "go2.xml"))
        stance = nominal_stance(robot).joint_position
        truth = truth_of(loaded, dict(zip(robot.joint_names, stance.tolist(), strict=True)))
        row: dict[str, object] = {"how": how, "step": step, "surface": surface, "truth": truth.tolist()}
        lockstep = how == "lockstep"
        settings = UnitreeDdsSettings(
            "lo", DOMAIN, release_sport_mode=False, silence=10.0 if lockstep else 0.5, accept_cyclonedds=VERSION
        )
        with bridge(given, loaded, "--step", str(step), *(["--lockstep"] if lockstep else [])) as simulator:
            link = open_link(robot, settings)
            platform = Lockstep(robot, link) if lockstep else HardwarePlatform(link)
            try:
                with Guard(platform, robot) as guard:
                    result = calibrate(guard, robot, Precise(surface=surface).weighed(truth[0], SCALE * truth[0]))
            except EquipoiseError as error:
                return {**row, "failed": f"{type(error).__name__}: {error}", "alive": simulator.poll() is None}
            row["alive"] = simulator.poll() is None
    found = result.composite
    row["verdicts"] = [str(value.verdict) for value in (found.mass, *found.com_in_base, *found.inertia.moments)]
    row["robot_time"] = sum(trial.duration for trial in result.trials)
    return {
        **row,
        "error": (found.values - truth).tolist(),
        "sd": found.deviations.tolist(),
        "warnings": list(result.warnings),
    }


def dds(given: argparse.Namespace, kept: list[dict[str, object]]) -> Generator[list[dict[str, object]]]:
    """Calibrations over the public simulator's bridge, those that are not kept."""
    keys = ("how", "step", "surface")
    done = {tuple(row[key] for key in keys): row for row in kept}
    for how, step, surface in PLANNED:
        row = done.get((how, step, surface)) or calibrated(given, how, step, surface)
        done[how, step, surface] = row
        print({key: value for key, value in row.items() if key not in ("truth", "sd")}, flush=True)
        yield list(done.values())


def udp(given: argparse.Namespace, kept: list[dict[str, object]]) -> Generator[list[dict[str, object]]]:
    yield kept


def sources(given: argparse.Namespace) -> list[str]:
    """The checkouts that were run."""
    return [checkout(path) for name, path in vars(given).items() if name in ("mujoco", "sdk2", "legged")]


def page(found: dict[str, object]) -> str:
    return json.dumps(found)


def checkout(path: str) -> str:
    """Where a checkout came from, and its commit."""

    def git(*arguments: str) -> str:
        return subprocess.run(
            ["git", "-C", path, *arguments], capture_output=True, text=True, check=True
        ).stdout.strip()

    return f"{Path(path).resolve().name} {git('rev-parse', '--short=10', 'HEAD')}"


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
        found[given.part] = {"of": sources(given), "commit": commit(), "rows": rows}
        ROWS.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    (RESULTS / "foreign.md").write_text(page(found), encoding="utf-8")


if __name__ == "__main__":
    main()
