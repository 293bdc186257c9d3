"""What every peer is given: recordings of one simulated robot with a payload, the same for all of them.

A robot is drawn from its seed as `benchmarks/accuracy.py` draws it: payload, sensor errors, and what a scale says. Four runs
are recorded, each by the routine of the name: `bayesian`, `paper`, `static`, and `shake`, a motion that was made for the
peers that need one: the body turns about three axes and moves along three at once, over planted feet, for 20 s.
"""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import accuracy
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from equipoise import BayesianMethod, Method, RunFolder, calibrate, load_robot, nominal_stance, simulate
from equipoise.errors import RecordingError
from equipoise.experiments.stand import stand_up
from equipoise.experiments.standing_robot import StandingRobot
from equipoise.method.table import method_named
from equipoise.paper.excitation import why_not_standing
from equipoise.platform.platform import Platform, TiltLimit, Trajectory
from equipoise.recording.event import TRIAL
from equipoise.recording.recording import Recording
from equipoise.robot.inertial import components, composite_parameters
from equipoise.robot.kinematics import feet_under_base
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance
from equipoise.simulation.effects import REALISTIC

FloatArray = NDArray[np.float64]

RUNS = ("bayesian", "paper", "static", "shake")
TRUTH, FEED_FORWARD = "components.npz", "feed_forward.npz"

_GRAVITY = 9.81
# No two are multiples of one another, and all directions of all joints come back at many phases of the others.
_TURN_FREQUENCIES, _SHIFT_FREQUENCIES = np.array([2.3, 1.9, 1.5]), np.array([1.1, 1.3, 0.9])  # [Hz]
# Of 0.7, 1, 1.3 and 1.7 times this, on an A1 of a tuning seed, this let `projected` come nearest: less drowns in joint
# friction, with more the feet lift.
_LARGEST_TURN, _LARGEST_SHIFT = 0.045, np.array([0.009, 0.009, 0.0075])  # [rad], [m]
_LOAD_SHARE = 0.18  # of a foot's static load that turning about one axis may take
_SIZES = (1.0, 0.85, 0.7, 0.5)
_KNOTS_PER_PERIOD = 12
_DURATION, _RAMP, _SETTLE = 20.0, 1.0, 0.5  # [s]


class CommandTap:
    """A platform that remembers the feed-forward torques sent through it: a recording keeps only position targets."""

    def __init__(self, platform: Platform) -> None:
        self.platform = platform
        self.time: list[FloatArray] = []
        self.torque: list[FloatArray] = []

    def __getattr__(self, name: str) -> object:
        return getattr(self.platform, name)

    def play(self, trajectory: Trajectory, stop: TiltLimit | None = None) -> Recording:
        recording = self.platform.play(trajectory, stop)
        count = len(recording.joints.time)
        torque = np.zeros_like(trajectory.position) if trajectory.torque is None else trajectory.torque
        self.time.append(recording.joints.time)
        self.torque.append(np.array(torque[:count]))
        return recording


@dataclass(frozen=True)
class Case:
    """One simulated robot: a model's name and the seed of payload, sensor errors, noise and scale."""

    robot_name: str
    seed: int

    @cached_property
    def robot(self) -> RobotModel:
        return load_robot(self.robot_name)

    @cached_property
    def stance(self) -> Stance:
        return nominal_stance(self.robot)

    def folder(self, kept: Path) -> Path:
        return kept / f"{self.robot_name}-{self.seed}"


@dataclass(frozen=True, eq=False)
class Known:
    """What a baseline is given besides the recordings.

    Attributes:
        mass: of the whole robot by the scale [kg].
        mass_std: its standard deviation [kg].
    """

    mass: float
    mass_std: float


def record(case: Case, kept: Path) -> None:
    """Make the four runs of a robot, unless they are there."""
    folder = case.folder(kept)
    generator = np.random.default_rng([case.seed, 77])
    payload = accuracy.payload_of(case.robot, generator)
    sizes = REALISTIC.scaled_to(case.stance.scale)
    settings: Method | None = None
    for run in RUNS:
        if settings is not None and (folder / run / FEED_FORWARD).exists():
            continue
        with simulate(case.robot, sizes, payload, case.seed) as simulation:
            if settings is None:
                true = components(simulation.truth.composite)
                drawn_as = accuracy.Case(case.robot_name, case.seed, "bayesian", "realistic")
                settings = accuracy.settings_of(drawn_as, float(true[0]), generator)
                folder.mkdir(parents=True, exist_ok=True)
                weighed = settings if isinstance(settings, BayesianMethod) else BayesianMethod()
                scale = [weighed.mass or 0.0, weighed.mass_std or 0.0]
                np.savez(folder / TRUTH, composite=true, scale=scale)
            if not (folder / run / FEED_FORWARD).exists():
                _record(case, simulation.platform, run, settings, folder / run)


def _record(case: Case, platform: Platform, run: str, settings: Method, folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)  # of a run that was cut short
    tap, recordings = CommandTap(platform), list[Recording]()
    if run == "shake":
        shake(tap, case.robot, case.stance, recordings.append)
    else:
        calibrate(tap, case.robot, settings if settings.name == run else method_named(run)(), recordings.append)
    with RunFolder.create(folder, case.robot, settings, {}) as store:
        for recording in recordings:
            store.keep(recording)
    np.savez_compressed(folder / FEED_FORWARD, time=np.concatenate(tap.time), torque=np.concatenate(tap.torque))


def load(case: Case, kept: Path, run: str) -> list[Recording]:
    """The recordings of a run."""
    return RunFolder.open(case.folder(kept) / run).recordings()


def known(case: Case, kept: Path) -> Known:
    """What the scale says."""
    with np.load(case.folder(kept) / TRUTH) as stored:
        return Known(*(float(value) for value in stored["scale"]))


def truth(case: Case, kept: Path) -> FloatArray:
    """(10,) the whole robot at the nominal stance, in the order of COMPONENTS; for the benchmark alone, never a peer."""
    with np.load(case.folder(kept) / TRUTH) as stored:
        return np.array(stored["composite"])


def shake(platform: Platform, robot: RobotModel, stance: Stance, keep: Callable[[Recording], None]) -> None:
    """Turn and move the body about and along all axes at once; phases "rest", "ramp", "excitation" and "end".

    If the feet move it is done again with less. Only the last recording is kept.

    Raises:
        RecordingError: the feet moved however little the body did.
    """
    standing, _ = stand_up(platform, robot, stance)
    problem: str | None = None
    for size in _SIZES:
        recording = _play_shake(standing, stance, size)
        # By the feet's distances: joint friction spoils loads that are read from torques.
        joints = dataclasses.replace(recording.joints, torque=None)
        problem = why_not_standing(robot, dataclasses.replace(recording, joints=joints))
        if problem is None:
            keep(recording)
            return
    raise RecordingError(f"the feet moved while {robot.name} shook: {problem}")


def _play_shake(standing: StandingRobot, stance: Stance, size: float) -> Recording:
    body = composite_parameters(standing.robot, stance.joint_position)
    slow = 1 / stance.scale.time
    turn_rate, shift_rate = 2 * np.pi * slow * _TURN_FREQUENCIES, 2 * np.pi * slow * _SHIFT_FREQUENCIES
    arms = np.abs(stance.feet_in_base[:, :2] - body.com[:2]).mean(axis=0)
    lever = np.array([arms[1], arms[0], 0.5 * float(np.hypot(*arms))])  # yaw is carried by half the load's friction
    most = _LOAD_SHARE * body.mass * _GRAVITY * lever / (np.diag(body.inertia) * turn_rate**2)
    turn, shift = size * np.minimum(most, _LARGEST_TURN), size * stance.scale.length * _LARGEST_SHIFT
    total = (_DURATION + 2 * _RAMP) / slow

    def feet_at(time: float) -> FloatArray:
        envelope = float(np.clip(min(time, total - time) * slow / _RAMP, 0, 1))
        rotation = np.array(pin.exp3(envelope * turn * np.sin(turn_rate * time)))
        moved = envelope * shift * np.sin(shift_rate * time)
        return feet_under_base(stance.feet_in_base, body.com + moved - rotation @ body.com, rotation)

    period = standing.platform.control_period
    time: FloatArray = np.arange(1.0, round(total / period) + 1) * period
    motion = standing.motion().event(TRIAL, kind="shake", size=size)
    motion.phase("settle").move_feet(stance.feet_in_base, _SETTLE).phase("rest").hold(_SETTLE)
    begin = motion.time
    motion.phase("ramp").follow(feet_at, int(_KNOTS_PER_PERIOD * total * slow * _TURN_FREQUENCIES.max()), time)
    motion.phase_at("excitation", begin + _RAMP / slow).phase_at("end", begin + total - _RAMP / slow)
    standing.play(motion.move_feet(stance.feet_in_base, _SETTLE).hold(_SETTLE))
    return standing.finish()
