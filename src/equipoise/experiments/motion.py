"""Open-loop motions as sequences of foot paths in the base frame, converted to joint targets."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import ReachError
from equipoise.platform.platform import Trajectory
from equipoise.platform.ramp import smooth_step
from equipoise.recording.event import PHASE, TRIAL, Event
from equipoise.recording.trials import RecordedTrial
from equipoise.robot.description import LEG_NAMES
from equipoise.robot.kinematics import foot_positions, inverse_kinematics
from equipoise.robot.model import RobotModel
from equipoise.robot.statics import static_torques

# Planned joint speeds stay below this fraction of the model's limit.
_SPEED_MARGIN = 0.8
# Largest factors by which a motion is slowed if it is too fast for a joint; less on two feet, where the robot tips.
_SLOWEST, _SLOWEST_ON_TWO_FEET = 10.0, 5.0
# Inverse kinematics runs at knots; the error of a cubic spline between knots at this distance is some micrometres.
_KNOT_SPACING_RATIO = 0.05  # of the leg length


@dataclass(frozen=True, eq=False)
class Target:
    """Commanded posture of a robot.

    Attributes:
        joint_position: (nj,) joint position targets [rad].
        feet_in_base: (4, 3) foot positions in the base frame at these targets [m].
        torque: (nj,) feed-forward torques [Nm].
        legs: legs that are meant to stand.
    """

    joint_position: FloatArray
    feet_in_base: FloatArray
    torque: FloatArray
    legs: tuple[str, ...] = LEG_NAMES

    @classmethod
    def standing(cls, robot: RobotModel, joint_position: FloatArray) -> Target:
        """Return the target at rest on four feet with given joint positions."""
        torque = static_torques(robot, joint_position, LEG_NAMES)
        return cls(joint_position, foot_positions(robot, joint_position), torque)

    @classmethod
    def lying(cls, robot: RobotModel, joint_position: FloatArray) -> Target:
        """Return the target at rest on the belly: the legs carry only their own weight."""
        return cls(joint_position, foot_positions(robot, joint_position), static_torques(robot, joint_position, ()), ())


class Motion:
    """Motion under construction: commanded foot paths, phase by phase.

    Every command has feed-forward torques that hold the model's posture against gravity on the standing legs. With
    position control alone, an A1 sags by 15 mm when it lifts two feet, and the feet stay on the floor.

    A motion that exceeds a joint's allowed speed is slowed, up to a largest factor; beyond it `build` raises ReachError.

    Args:
        robot: the robot.
        control_period: time between commands [s].
        start: targets that the motion starts from.

    Attributes:
        target: targets at the end of the motion so far.
        count: number of control periods so far.
        slowed: factor by which the last path is slower than requested.
    """

    def __init__(self, robot: RobotModel, control_period: float, start: Target) -> None:
        self.robot = robot
        self.control_period = control_period
        self.target = start
        self._positions: list[FloatArray] = []
        self._torques: list[FloatArray] = []
        self._events: list[Event] = []
        self.count = 0
        self._limp = False
        self._path_start, self.slowed = 0.0, 1.0
        self._gains: tuple[FloatArray, FloatArray] | None = None

    @property
    def time(self) -> float:
        """Time planned so far [s]."""
        return self.count * self.control_period

    def event(self, name: str, /, **data: Any) -> Motion:
        """Add an event at the end of the motion so far."""
        self._events.append(Event(self.time, name, data))
        return self

    def begin(self, trial: RecordedTrial) -> Motion:
        """Mark the beginning of a trial."""
        return self.event(TRIAL, **trial.to_data())

    def phase(self, name: str) -> Motion:
        """Begin a phase."""
        return self.event(PHASE, name=name)

    def phase_at(self, name: str, time: float) -> Motion:
        """Begin a phase at a time [s] within or after the last path, which is stretched if that path was slowed."""
        if self.slowed > 1:
            time = self._path_start + self.slowed * (time - self._path_start)
        self._events.append(Event(time, PHASE, {"name": name}))
        return self

    def hold(self, duration: float) -> Motion:
        """Keep the present targets."""
        count = self._count(duration)
        self._append(np.repeat(self.target.joint_position[None], count, axis=0), self.target.torque[None])
        return self

    def hold_limp(self, duration: float) -> Motion:
        """Damp the joints without position control; a motion with this has no other parts."""
        self.target, self._limp = replace(self.target, torque=np.zeros_like(self.target.torque)), True
        return self.hold(duration)

    def with_gains(self, kp: FloatArray, kd: FloatArray) -> Motion:
        """Use other gains, (nj,) kp [Nm/rad] and kd [Nm s/rad], in the whole motion."""
        self._gains = kp, kd
        return self

    def swing_joints(self, swing: FloatArray) -> Motion:
        """Play (n, nj) joint offsets from the present posture [rad]; feet stay at their targets if all offsets end at zero."""
        self._append(self.target.joint_position + swing, self.target.torque[None])
        return self

    def relax(self, duration: float, joints: Sequence[int]) -> Motion:
        """Keep the posture, and fade out the feed-forward torques of some joints, by index."""
        faded = np.zeros_like(self.target.torque)
        faded[list(joints)] = 1.0
        fading = 1 - smooth_step(self._count(duration))[:, None] * faded
        self._append(np.repeat(self.target.joint_position[None], len(fading), axis=0), fading * self.target.torque)
        return self

    def shift_load(self, legs: tuple[str, ...], duration: float) -> Motion:
        """Keep the posture, and shift the load to some of the legs by their torques."""
        torque = _cached_torques(self.robot, self.target.joint_position.tobytes(), legs)
        step = smooth_step(self._count(duration))[:, None]
        self._append(
            np.repeat(self.target.joint_position[None], len(step), axis=0),
            (1 - step) * self.target.torque + step * torque,
        )
        self.target = replace(self.target, torque=torque, legs=legs)
        return self

    def move_feet(self, feet_in_base: FloatArray, duration: float) -> Motion:
        """Move the feet on straight lines in the base frame, starting and ending at rest.

        Raises:
            ReachError: a point of the path is out of reach.
        """
        return self._move_along_lines(feet_in_base, smooth_step(self._count(duration)))

    def step_feet(self, feet_in_base: FloatArray, duration: float) -> Motion:
        """Move the feet as `move_feet`, and back, each in the duration."""
        there = smooth_step(self._count(duration))
        return self._move_along_lines(feet_in_base, np.concatenate([there, 1 - there]))

    def move_joints(self, joint_position: FloatArray, duration: float) -> Motion:
        """Move every joint on a straight path to its (nj,) position [rad], starting and ending at rest."""
        step = smooth_step(self._count(duration))[:, None]
        position = self.target.joint_position + step * (joint_position - self.target.joint_position)
        torque = np.array([static_torques(self.robot, row, self.target.legs) for row in position])
        self._append(position, torque)
        self.target = replace(self.target, feet_in_base=foot_positions(self.robot, joint_position))
        return self

    def follow(self, feet_at: Callable[[float], FloatArray], knots: int, parameter: FloatArray) -> Motion:
        """Move the feet along a one-parameter family of positions.

        Args:
            feet_at: function from a parameter value to (4, 3) foot positions in the base frame [m].
            knots: number of parameter values at which inverse kinematics runs.
            parameter: (n,) values of the parameter, one per control period.
        """
        self._append(*_path(self.robot, self.target.joint_position, feet_at, knots, parameter, self.target.legs))
        self.target = replace(self.target, feet_in_base=feet_at(float(parameter[-1])))
        return self

    def build(self) -> Trajectory:
        """Return the motion as a trajectory.

        Raises:
            ReachError: a joint would exceed its speed limit by far.
        """
        position = np.concatenate(self._positions)
        self._check_speed(position)
        torque = np.concatenate(self._torques)
        kp, kd = self._gains or (None, None)
        return Trajectory(position, torque=torque, events=tuple(self._events), limp=self._limp, kp=kp, kd=kd)

    def _move_along_lines(self, feet_in_base: FloatArray, parameter: FloatArray) -> Motion:
        start, end = self.target.feet_in_base, np.array(feet_in_base, dtype=float)
        joints = self.target.joint_position
        path = _line(
            self.robot, joints.tobytes(), start.tobytes(), end.tobytes(), parameter.tobytes(), self.target.legs
        )
        self._append(*path)
        self.target = replace(self.target, feet_in_base=start + parameter[-1] * (end - start))
        return self

    def _count(self, duration: float) -> int:
        return max(1, round(duration / self.control_period))

    def _append(self, position: FloatArray, torque: FloatArray) -> None:
        position, torque = self._slow_enough(position, np.broadcast_to(torque, position.shape))
        self._positions.append(position)
        self._torques.append(torque)
        self.count += len(position)
        self.target = replace(self.target, joint_position=position[-1], torque=self._torques[-1][-1])

    def _slow_enough(self, position: FloatArray, torque: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the path, slowed to the allowed speed of its fastest joint, or unchanged if that takes too long."""
        self._path_start, self.slowed = self.time, 1.0
        start = np.concatenate([[self.target.joint_position], position])
        excess = float(self._speeds(start)[1].max())
        if not 1 < excess <= (_SLOWEST if len(self.target.legs) != 2 else _SLOWEST_ON_TWO_FEET):
            return position, torque
        count = math.ceil(excess * len(position))
        self.slowed = count / len(position)
        rows, at = np.arange(len(start), dtype=float), np.linspace(0, len(position), count + 1)[1:]
        torques = np.concatenate([[self.target.torque], torque])
        return _at_rows(start, rows, at), _at_rows(torques, rows, at)

    def _speeds(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the (nj,) largest speeds [rad/s], and their ratios to the speeds allowed in plans."""
        speed = np.abs(np.diff(position, axis=0)).max(axis=0, initial=0.0) / self.control_period
        return speed, speed / (_SPEED_MARGIN * self.robot.velocity_limit)

    def _check_speed(self, position: FloatArray) -> None:
        speed, excess = self._speeds(position)
        worst = int(np.argmax(excess))
        if excess[worst] > 1:
            raise ReachError(
                f"joint {self.robot.joint_names[worst]!r} would have to turn at {speed[worst]:.2f} rad/s; plans use at most "
                f"{_SPEED_MARGIN:.0%} of its limit of {self.robot.velocity_limit[worst]:.2f} rad/s: "
                "use a smaller or slower motion"
            )


def _at_rows(path: FloatArray, rows: FloatArray, at: FloatArray) -> FloatArray:
    """Return (m, nj) rows of an (n, nj) path, interpolated at fractional row numbers."""
    columns: list[FloatArray] = [np.interp(at, rows, column) for column in path.T]
    return np.array(columns).T


def _path(
    robot: RobotModel, guess: FloatArray, feet_at: Callable[[float], FloatArray], knots: int, parameter: FloatArray,
    legs: tuple[str, ...],
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Return (n, nj) joint positions and torques along a family of foot positions; `guess` is near its start."""
    grid = np.linspace(float(parameter.min()), float(parameter.max()), knots)
    first = int(np.argmin(np.abs(grid - parameter[0])))
    solved = np.empty((knots, len(guess)))
    for order in (range(first, knots), range(first - 1, -1, -1)):
        near = guess if order.start == first else solved[first]
        for knot in order:
            near = solved[knot] = inverse_kinematics(robot, feet_at(float(grid[knot])), near)
    torques = np.array([static_torques(robot, position, legs) for position in solved])
    from scipy.interpolate import CubicSpline  # noqa: PLC0415 - a third of a second to import

    position, torque = np.hsplit(np.asarray(CubicSpline(grid, np.hstack([solved, torques]))(parameter)), 2)
    return position, torque


@lru_cache(maxsize=512)
def _cached_torques(robot: RobotModel, joint_position: bytes, legs: tuple[str, ...]) -> FloatArray:
    """Return the cached `static_torques`."""
    torque = static_torques(robot, np.frombuffer(joint_position), legs)
    torque.setflags(write=False)
    return torque


@lru_cache(maxsize=512)  # a search repeats its moves: half of those in one run, nearly all in many runs
def _line(
    robot: RobotModel, guess: bytes, start: bytes, end: bytes, parameter: bytes, legs: tuple[str, ...]
) -> tuple[FloatArray, FloatArray]:
    """Return `_path` on straight lines of the feet; arrays are bytes, which can be cache keys."""
    begin, goal = (np.frombuffer(feet).reshape(4, 3) for feet in (start, end))
    longest = float(np.linalg.norm(goal - begin, axis=1).max())
    knots = 3 + math.ceil(longest / (_KNOT_SPACING_RATIO * robot.leg_length))
    path = _path(
        robot, np.frombuffer(guess), lambda s: begin + s * (goal - begin), knots, np.frombuffer(parameter), legs
    )
    for array in path:
        array.setflags(write=False)
    return path
