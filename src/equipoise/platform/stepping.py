"""Recordings of motions from the samples and commands of control periods."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.platform.platform import MotionInterrupted, Platform, RobotState, Trajectory
from equipoise.platform.tilt_limit import TiltLimit, TiltTest
from equipoise.recording.recording import CommandStream, Event, ImuStream, JointStream, Recording

_LAG_SHARE = 0.02  # of a new sample, in the estimated offset between the robot's clock and ours
_LEAST_STEP = 1e-6  # [s] between two commands
_GRID = 1e-9  # [s] on which times are recorded
_PAUSE = 0.25  # [s] between two motions whose samples are recorded with the second one


class Recorder:
    """Recorder of a platform's samples and commands, one recording per motion.

    A recording has one row per command: the samples that arrived before it, and the command. Samples after the last command
    belong to the next motion.

    Args:
        joint_names: names of the platform's joints.
        period: control period [s].

    Attributes:
        count: number of commands in the current motion.
    """

    def __init__(self, joint_names: tuple[str, ...], period: float) -> None:
        self._joint_names, self._period = joint_names, period
        self._waiting: list[RobotState] = []
        self._rows: list[list[RobotState]] = []
        self._targets: list[FloatArray] = []
        self._sent: list[float] = []
        self._lag: float | None = None
        self._last = -math.inf  # time of the last command, on the robot's clock [s]
        self._recorded = (-math.inf, -math.inf)  # times of the last joint and IMU samples of earlier motions [s]

    @property
    def count(self) -> int:
        return len(self._sent)

    def restart(self) -> None:
        """Discard all samples but the newest one."""
        self._waiting = self._waiting[-1:]

    def begin(self) -> None:
        """Begin a motion; after a longer pause, discard all earlier samples but the newest one."""
        if (last := next((row for row in reversed(self._rows) if row), None)) is not None:
            self._recorded = max(sample.time for sample in last), max(map(_imu_time, last))
        if self._waiting and self._waiting[-1].time - self._recorded[0] > _PAUSE:
            self._waiting = self._waiting[-1:]
        self._rows, self._targets, self._sent = [], [], []

    def take(self, target: FloatArray | None, sent: float | None, samples: Iterable[RobotState]) -> None:
        """Add one control period: a command, and the samples that arrived after it.

        Args:
            target: (nj,) joint position targets of the current motion [rad]; None between motions: the samples of a short
                pause are recorded with the next motion.
            sent: time at which the command was sent, on this computer's monotonic clock [s]; None in simulation.
            samples: samples that arrived.
        """
        if target is None:
            self._waiting += samples
            if len(self._waiting) > 1 and self._waiting[0].time < self._waiting[-1].time - _PAUSE:
                self._waiting = [s for s in self._waiting if s.time >= self._waiting[-1].time - _PAUSE]
            return
        self._sent.append(self._by_robot_clock(sent))
        self._rows.append(self._waiting)
        self._targets.append(target)
        self._waiting = list(samples)

    def recorded(self, events: tuple[Event, ...] = ()) -> Recording | None:
        """Return the current motion so far, or None if no command was sent."""
        return self.recording(events) if self.count else None

    def recording(self, events: tuple[Event, ...] = (), first: int = 0) -> Recording:
        """Return the recording from command `first` on; times of events count from the motion's beginning [s]."""
        samples = [sample for row in self._rows[first:] for sample in row]
        begin = next((sample.time for row in self._rows for sample in row), 0.0)
        end = samples[-1].time if samples else begin
        latest, happened = self._recorded, started_events(events, begin, end)
        if (before := next((row for row in reversed(self._rows[:first]) if row), None)) is not None:
            latest = max(sample.time for sample in before), max(map(_imu_time, before))
            happened = tuple(event for event in happened if event.time > before[-1].time + _GRID)
        targets, sent = np.array(self._targets[first:]), np.array(self._sent[first:])
        return recording_of(self._joint_names, samples, targets, happened, sent, latest)

    def _by_robot_clock(self, sent: float | None) -> float:
        """Return the time of a command on the robot's clock [s]; these times always increase."""
        before = self._waiting[-1] if self._waiting else None
        if sent is None or before is None or before.received is None:
            at, least = (self._last + self._period if before is None else before.time), self._period
        else:
            lag = before.time - before.received
            self._lag = lag if self._lag is None else self._lag + _LAG_SHARE * (lag - self._lag)
            at, least = sent + self._lag, _LEAST_STEP
        self._last = at if self._last + _GRID <= at < math.inf else self._last + least
        return self._last


def play_by_stepping(platform: Platform, trajectory: Trajectory, stop: TiltLimit | None = None) -> Recording:
    """Play a motion on a platform with only `read` and `step`, and record the states that they return.

    Raises:
        MotionInterrupted: Ctrl-C; carries the recording so far.
    """
    recorder = Recorder(platform.joint_names, platform.control_period)
    recorder.take(None, None, [platform.read()])
    test = TiltTest(stop, platform.control_period)
    try:
        for index in range(len(trajectory.position)):
            command = trajectory.command(index)
            sent = time.monotonic()
            state = platform.step(command)
            recorder.take(command.position, None if state.received is None else sent, [state])
            if test.reached(state.angular_velocity_in_imu[None], state.joint_position[None]):
                break
    except KeyboardInterrupt:
        raise MotionInterrupted(recorder.recorded(trajectory.events)) from None
    return recorder.recording(trajectory.events)


def recording_of(
    joint_names: tuple[str, ...],
    samples: Sequence[RobotState],
    targets: FloatArray,
    events: tuple[Event, ...],
    sent: FloatArray | None = None,
    before: tuple[float, float] = (-math.inf, -math.inf),
) -> Recording:
    """Return a recording of samples, each once, and of the joint targets that were sent.

    Args:
        targets: (n, nj) position targets [rad].
        sent: (n,) times at which they were sent, on the robot's clock [s]; None: one for each sample, at its time.
        before: times of the last joint and IMU samples before these [s]; samples that are not younger are repeated.
    """
    joints = _each_once(samples, lambda sample: sample.time, before[0])
    imu = _each_once(samples, _imu_time, before[1])
    width = len(joint_names)
    velocities = [sample.joint_velocity for sample in joints if sample.joint_velocity is not None]
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
        CommandStream(np.array([sample.time for sample in samples]) if sent is None else sent, targets),
        events,
    )


def _imu_time(sample: RobotState) -> float:
    return sample.time if sample.imu_time is None else sample.imu_time


def _each_once(
    samples: Sequence[RobotState], time_of: Callable[[RobotState], float], latest: float
) -> list[RobotState]:
    """Return the samples that are younger than all earlier ones."""
    kept: list[RobotState] = []
    for sample in samples:
        if latest + _GRID <= time_of(sample) < math.inf:
            kept.append(sample)
            latest = time_of(sample)
    return kept


def started_events(events: tuple[Event, ...], start: float, last: float) -> tuple[Event, ...]:
    """Return a trajectory's events with absolute times, without those after the last sample."""
    moved = (Event(start + event.time, event.name, event.data) for event in events)
    return tuple(event for event in moved if event.time <= last + _GRID)
