"""Emulated robots in processes of their own, and a slow motion for them."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Generator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from rows import NotTriedError  # isort: skip - it limits the threads of NumPy
import numpy as np
from simulated import robot_called

from equipoise import Trajectory, nominal_stance
from equipoise.platform.platform import Platform

ROBOT = "unitree_a1"
GO2_DOMAIN = 71  # DDS domain of an emulated Go2
GO2 = {"interface": "lo", "domain": GO2_DOMAIN}
"""Settings of the connection to an emulated Go2."""


@contextmanager
def emulator(protocol: str, *flags: object) -> Generator[None]:
    """Run an emulator with the A1's model and its flags; it is ready when the block begins.

    Raises:
        NotTriedError: the emulator ends at its start, for example because a package is missing.
    """
    command = [sys.executable, "-m", "equipoise", "lab", "emulate", protocol, "--robot", ROBOT, *map(str, flags)]
    with tempfile.NamedTemporaryFile() as log:
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log)
        try:
            while '"ready"' not in Path(log.name).read_text(encoding="utf-8"):
                if process.poll() is not None:
                    raise NotTriedError(f"an emulator ended at its start: {Path(log.name).read_text(encoding='utf-8')}")
                time.sleep(0.1)
            yield
        finally:
            process.terminate()
            process.wait(timeout=10)


def standing_go2() -> AbstractContextManager[None]:
    """Run an emulated Go2 without errors that stands."""
    flags = ("--domain", GO2_DOMAIN, "--sim-preset", "ideal", "--start", "standing", "--no-sport-mode")
    return emulator("unitree-dds", *flags)


def oscillate(platform: Platform, seconds: float) -> None:
    """Play `excitation` again and again for a time."""
    motion = excitation()
    for _ in range(round(seconds / (len(motion.position) * platform.control_period))):
        platform.play(motion)


def excitation() -> Trajectory:
    """Return a slow motion of five seconds that extends and retracts all legs."""
    robot = robot_called(ROBOT)
    at = 2e-3 * np.arange(2500)
    position = np.repeat(np.array(nominal_stance(robot).joint_position)[None], len(at), axis=0)
    for place, leg in enumerate(robot.legs.values()):
        wave = 0.05 * np.sin(2 * np.pi * at) * (-1) ** place
        position[:, leg.joints[-2]] += wave
        position[:, leg.joints[-1]] -= 2 * wave
    return Trajectory(position)
