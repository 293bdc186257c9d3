"""Motions of platforms that only step: what is sensed and sent, step by step, until it is made a recording."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import time
from collections.abc import Callable, Sequence
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError, UnrecordedError
from equipoise.platform.platform import Health, MotionInterrupted, Platform, RobotState, Trajectory
from equipoise.platform.tilt_limit import TiltLimit, TiltTest
from equipoise.recording.recording import CommandStream, Event, ImuStream, JointStream, Recording

_LAG_SHARE = 0.02  # of a new sample, in how far the robot's clock is from ours
_LEAST_STEP = 1e-6  # [s] between two commands
_GRID = 1e-9  # [s] on which times are recorded
_played: WeakKeyDictionary[Platform, StepLog] = WeakKeyDictionary()
"""The last motion of every platform that `play_by_stepping` moved."""


def play_by_stepping(platform: Platform, trajectory: Trajectory, stop: TiltLimit | None = None) -> Recording:
    """`play` for platforms that have only `read` and `step`.

    A sample that the platform hands out again, within a motion or where two meet, is recorded once; a step that brings no new
    one, none. The motion before is known by the platform itself, which is to be hashable by identity, as objects are.

    Raises:
        MotionInterrupted: Ctrl-C; carries the recording so far.
        UnrecordedError: what was sensed makes no recording; carries it as it is.
    """
    previous: StepLog | None = None
    with contextlib.suppress(TypeError):  # a platform that cannot be a key has no motion before
        previous = _played.get(platform)
    steps = StepLog(platform, following(platform.read(), previous), previous)
    with contextlib.suppress(TypeError):
        _played[platform] = steps
    test = TiltTest(stop, platform.control_period)
    try:
        for index in range(len(trajectory.position)):
            command = trajectory.command(index)
            state = steps.add(command.position, lambda command=command: platform.step(command))
            if test.reached(state.angular_velocity_in_imu[None], state.joint_position[None]):
                break
    except KeyboardInterrupt:
        raise MotionInterrupted(steps.recording(trajectory.events) if steps.count else None) from None
    return steps.recording(trajectory.events)


def following(state: RobotState, previous: StepLog | None) -> RobotState:
    """The present state; with it the last one of the motion before, which no recording has yet.

    A simulated robot waits: if it is later there, somebody else stepped it, who has that state.
    """
    last = None if previous is None else previous.state
    if last is None or last.time >= state.time or state.received is None:
        return state
    return dataclasses.replace(state, earlier=(dataclasses.replace(last, earlier=()), *state.earlier))


class StepLog:
    """What is sensed and sent, step by step, until it is made a recording.

    Args:
        platform: platform that is stepped.
        start: state before the first step.
        previous: the steps before these, which no time of these may come before.

    Attributes:
        state: the newest state.
        count: number of steps.
    """

    def __init__(self, platform: Platform, start: RobotState, previous: StepLog | None = None) -> None:
        self.state = start
        self._joint_names, self._period = platform.joint_names, platform.control_period
        self._states: list[RobotState] = []
        self._targets: list[FloatArray] = []
        self._sent: list[float] = []
        self._lag = None if previous is None else previous._lag
        self._sent_last = -np.inf if previous is None else previous._sent_last
        self._before: RobotState | None = None
        if previous is not None:
            self._before = previous._states[-1] if previous._states else previous._before

    @property
    def count(self) -> int:
        return len(self._sent)

    def add(self, target: FloatArray, step: Callable[[], RobotState]) -> RobotState:
        """Do one step, which sends (nj,) joint targets [rad], and note it once it is done."""
        begun = time.monotonic()
        before, self.state = self.state, step()
        sent = begun if self.state.commanded is None else self.state.commanded  # a step waits for its deadline first
        self._states.append(before)
        self._targets.append(target)
        self._sent.append(self._by_robot_clock(sent, before))
        return self.state

    def recording(self, events: tuple[Event, ...] = (), first: int = 0, last: int | None = None) -> Recording:
        """The steps from one on, up to another, with the events of that time; events count from the first step of all [s].

        Raises:
            UnrecordedError: they make no recording.
        """
        last = self.count if last is None else last  # a step that was interrupted may be noted by half
        states = self._states[first:last]
        before = self._states[first - 1] if first else None
        happened = started_events(events, self._states[0].time, states[-1].time)
        try:
            return recording_of(
                self._joint_names,
                states,
                np.array(self._targets[first:last]),
                happened if before is None else tuple(event for event in happened if event.time > before.time + 1e-9),
                np.array(self._sent[first:last]),
                before or self._before,
            )
        except (RecordingError, ValueError) as error:
            raise UnrecordedError(str(error), self._as_measured(first, last)) from error

    def _as_measured(self, first: int, last: int) -> dict[str, Any]:
        """The same as JSON values."""
        rows = zip(self._states[first:last], self._sent[first:last], self._targets[first:last], strict=True)
        steps = [{"sensed": _plain(state), "time": sent, "sent": _plain(target)} for state, sent, target in rows]
        return {"joint_names": list(self._joint_names), "steps": steps}

    def _by_robot_clock(self, sent: float, state: RobotState) -> float:
        """When a command was sent [s]. In simulation: with the sample before it.

        A sample that came again, or late, was followed by a command all the same: times of commands always increase.
        """
        if state.received is None:
            at, least = state.time, self._period
        else:
            lag = state.time - state.received
            if math.isfinite(lag):
                self._lag = lag if self._lag is None else self._lag + _LAG_SHARE * (lag - self._lag)
            at, least = sent + (self._lag or 0.0), _LEAST_STEP
        later = self._sent_last + least if math.isfinite(self._sent_last) else 0.0
        self._sent_last = at if self._sent_last + _GRID <= at < math.inf else later
        return self._sent_last


def recording_of(
    joint_names: tuple[str, ...],
    states: Sequence[RobotState],
    targets: FloatArray,
    events: tuple[Event, ...],
    sent: FloatArray | None = None,
    before: RobotState | None = None,
) -> Recording:
    """What was sensed, samples that arrived in between included, each once; and the joint targets that were sent.

    Args:
        targets: (n, nj) position targets, one row a state [rad].
        sent: (n,) times at which they were sent, by the robot's clock [s]; default: the states' times.
        before: the last sample before these: what is not younger came twice.
    """
    samples = [sample for state in states for sample in (*state.earlier, state)]
    joints = _each_once(samples, _joint_time, before)
    imu = _each_once(samples, _imu_time, before)
    velocities = [sample.joint_velocity for sample in joints if sample.joint_velocity is not None]
    width = len(joint_names)
    torques = [sample.joint_torque for sample in joints if sample.joint_torque is not None]
    return Recording(
        joint_names,
        JointStream(
            np.array([sample.time for sample in joints]),
            np.array([sample.joint_position for sample in joints]).reshape(-1, width),
            np.array(velocities).reshape(-1, width) if len(velocities) == len(joints) else None,
            np.array(torques).reshape(-1, width) if len(torques) == len(joints) else None,
        ),
        ImuStream(
            np.array([_imu_time(sample) for sample in imu]),
            np.array([sample.angular_velocity_in_imu for sample in imu]).reshape(-1, 3),
            np.array([sample.acceleration_in_imu for sample in imu]).reshape(-1, 3),
        ),
        CommandStream(np.array([state.time for state in states]) if sent is None else sent, targets),
        events,
    )


def _joint_time(sample: RobotState) -> float:
    return sample.time


def _imu_time(sample: RobotState) -> float:
    return sample.time if sample.imu_time is None else sample.imu_time


def _each_once(
    samples: Sequence[RobotState], time_of: Callable[[RobotState], float], before: RobotState | None
) -> list[RobotState]:
    """Samples without those that came again, or too late, or do not say when they were taken."""
    kept: list[RobotState] = []
    latest = -np.inf if before is None or not math.isfinite(time_of(before)) else time_of(before)
    for sample in samples:
        if latest + _GRID <= time_of(sample) < math.inf:
            kept.append(sample)
            latest = time_of(sample)
    return kept


def _plain(value: Any) -> Any:
    """Records and arrays as JSON values."""
    if isinstance(value, (RobotState, Health)):
        return {field.name: _plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, (tuple, list)):
        return [_plain(part) for part in value]  # pyright: ignore[reportUnknownVariableType]
    return np.asarray(value, dtype=float).tolist() if isinstance(value, np.ndarray) else value


def started_events(events: tuple[Event, ...], start: float, last: float) -> tuple[Event, ...]:
    """A trajectory's events with absolute times, those after the last sample dropped."""
    moved = (Event(start + event.time, event.name, event.data) for event in events)
    return tuple(event for event in moved if event.time <= last + 1e-9)
