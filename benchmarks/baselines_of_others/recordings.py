"""Recordings that all baselines are given: runs of one simulated robot with a payload.

Four runs are recorded, each by the routine of its name: `bayesian`, `paper`, `static`, and `shake`, a motion for the baselines
that need one: the body turns about three axes and moves along three at once, over planted feet, for 20 s.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from simulated import SCALE_ERROR, payload_of, robot_called, weighed

from equipoise import BayesianMethod, calibrate, nominal_stance, simulate
from equipoise.errors import RecordingError
from equipoise.experiments.stand import stand_up
from equipoise.experiments.standing_robot import StandingRobot
from equipoise.method.table import method_named
from equipoise.paper.excitation import why_not_standing
from equipoise.platform.platform import Platform, TiltLimit, Trajectory
from equipoise.recording.event import TRIAL
from equipoise.recording.recording import Recording
from equipoise.robot.inertial import RobotInertia, composite_parameters
from equipoise.robot.kinematics import feet_under_base
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

FloatArray = NDArray[np.float64]

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
    """Platform that keeps the feed-forward torques of its commands; a recording has only their position targets."""

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


@dataclass(frozen=True, eq=False)
class Recorded:
    """Recordings of one simulated robot, and what its baselines are given besides them.

    Attributes:
        robot: model of the robot, without the payload.
        stance: its nominal stance.
        truth: the simulated robot.
        mass, mass_std: mass of the whole robot from a scale, and its standard deviation [kg].
        runs: recordings of each run.
        feed_forward: (n,) times and (n, nj) feed-forward torques of each run [s], [Nm].
    """

    robot: RobotModel
    stance: Stance
    truth: RobotInertia
    mass: float
    mass_std: float
    runs: dict[str, list[Recording]]
    feed_forward: dict[str, tuple[FloatArray, FloatArray]]


def record(name: str, seed: int, runs: Iterable[str]) -> Recorded:
    """Simulate runs of a robot; the seed determines payload, sensor errors, noise and scale."""
    robot, generator = robot_called(name), np.random.default_rng([seed, 77])
    stance, payload = nominal_stance(robot), payload_of(robot, generator)
    with simulate(robot, "realistic", payload, seed) as simulation:
        truth = simulation.truth
    mass = weighed(truth.composite.mass, generator)
    recorded = Recorded(robot, stance, truth, mass, SCALE_ERROR * mass, {}, {})
    for run in runs:
        with simulate(robot, "realistic", payload, seed) as simulation:
            tap, recordings = CommandTap(simulation.platform), list[Recording]()
            if run == "shake":
                shake(tap, robot, stance, recordings.append)
            else:
                method = (
                    BayesianMethod(mass=mass, mass_std=recorded.mass_std) if run == "bayesian" else method_named(run)()
                )
                calibrate(tap, robot, method, recordings.append)
        recorded.runs[run] = recordings
        recorded.feed_forward[run] = np.concatenate(tap.time), np.concatenate(tap.torque)
    return recorded


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
