"""Recordings: time-stamped sensor samples of one motion, with the commands and events.

Every stream has its own times, so that a clock offset between IMU and joints can be identified. A stream is validated when
it is created, and read-only afterwards. Its times are rounded to whole nanoseconds, so that a recording is the same on disk
and in memory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, TypeVar, cast

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.recording.clock import LONGEST, rounded
from equipoise.recording.event import BROKEN, PHASE, TRIAL, Event
from equipoise.recording.trials import RecordedTrial, read_trial


@dataclass(frozen=True, eq=False)
class JointStream:
    """Samples of the joint sensors; quantities that the robot does not measure are None.

    Attributes:
        time: (n,) increasing times [s].
        position: (n, nj) joint positions by the encoders [rad].
        velocity: (n, nj) joint velocities [rad/s], or None.
        torque: (n, nj) joint torques as the motors report them [Nm], or None.
    """

    kind: ClassVar[str] = "joint"
    time: FloatArray
    position: FloatArray
    velocity: FloatArray | None = None
    torque: FloatArray | None = None

    def __post_init__(self) -> None:
        shape = _validated_time(self, self.kind), _columns(self.position)
        for name in ("position", "velocity", "torque"):
            _validate(self, self.kind, name, shape, required=name == "position")

    @property
    def rates(self) -> FloatArray:
        """Return (n, nj) measured joint velocities, or differences of positions without them [rad/s]."""
        if self.velocity is not None:
            return self.velocity
        return np.asarray(np.gradient(self.position, self.time, axis=0), dtype=float)


@dataclass(frozen=True, eq=False)
class ImuStream:
    """Samples of gyroscope and accelerometer, in the IMU's frame.

    Attributes:
        time: (n,) increasing times [s].
        angular_velocity_in_imu: (n, 3) angular velocity of the IMU in its own frame [rad/s].
        acceleration_in_imu: (n, 3) specific force in the IMU frame, +g upward at rest [m/s2].
        pose_noise: (n, 2) densities of the white noise of positions and angles whose derivatives the acceleration and the
            angular velocity are [m/sqrt(Hz)], [rad/sqrt(Hz)]; zero for a sensor's readings, None if both are.
    """

    time: FloatArray
    angular_velocity_in_imu: FloatArray
    acceleration_in_imu: FloatArray
    pose_noise: FloatArray | None = None

    def __post_init__(self) -> None:
        count = _validated_time(self, "IMU")
        for name in ("angular_velocity_in_imu", "acceleration_in_imu"):
            _validate(self, "IMU", name, (count, 3), required=True)
        _validate(self, "IMU", "pose_noise", (count, 2), required=False)


class CommandStream(JointStream):
    """Commands that were sent: times [s] and joint position targets [rad]."""

    kind: ClassVar[str] = "command"


_Stream = TypeVar("_Stream", JointStream, ImuStream, CommandStream)


@dataclass(frozen=True, eq=False)
class Recording:
    """Samples and commands of one motion.

    Attributes:
        joint_names: (nj) names of the joint columns.
        joints: joint sensors.
        imu: inertial sensors.
        commands: commands that were sent, or None (an external log).
        events: events in order of time.
        trial_id: id of the trial in its run, by which the log finds its motions; None for external recordings.
        found_trial: trial that was found in a log; a commanded trial is stored in an event.
    """

    joint_names: tuple[str, ...]
    joints: JointStream
    imu: ImuStream
    commands: CommandStream | None = None
    events: tuple[Event, ...] = ()
    trial_id: int | None = None
    found_trial: RecordedTrial | None = None

    def __post_init__(self) -> None:
        for stream in (self.joints, self.commands):
            if stream is not None and (columns := stream.position.shape[1]) != len(self.joint_names):
                raise RecordingError(f"{columns} {stream.kind} columns and {len(self.joint_names)} joint names")

    @property
    def duration(self) -> float:
        """Return the time from the first to the last joint sample [s]."""
        return float(self.joints.time[-1] - self.joints.time[0]) if self.joints.time.size else 0.0

    @property
    def broken(self) -> bool:
        """Return whether the motion was broken off."""
        return any(event.name == BROKEN for event in self.events)

    def broken_off(self) -> Recording:
        """Return the recording with an event for a motion that was broken off."""
        end = float(self.joints.time[-1]) if self.joints.time.size else 0.0
        return self if self.broken else replace(self, events=(*self.events, Event(end, BROKEN)))

    def equals(self, other: Recording) -> bool:
        """Return whether another recording holds the same numbers, names and events, whatever its trial's id."""
        own, others = self._arrays(), other._arrays()
        return (
            self.joint_names == other.joint_names
            and self.events == other.events
            and len(own) == len(others)
            and all(np.array_equal(*arrays) for arrays in zip(own, others, strict=True))
        )

    def _arrays(self) -> list[Any]:
        """Return the arrays of all streams, None for one that is missing."""
        streams = [vars(stream) for stream in (self.joints, self.imu, self.commands) if stream is not None]
        return [array for stream in streams for array in stream.values()]

    @cached_property
    def trial(self) -> RecordedTrial | None:
        """Return the recording's trial; None if there is none, or its kind is unknown.

        Raises:
            RecordingError: the trial's data are damaged.
        """
        return self.found_trial or next((read_trial(event.data) for event in self.events if event.name == TRIAL), None)

    @property
    def complete(self) -> bool:
        """Return whether its trial has reached its purpose, even if it was interrupted later."""
        trial = self.trial
        return trial is not None and self.has_phase(trial.complete_with)

    @property
    def refused(self) -> bool:
        """Return whether its trial was never begun, as by lifting feet: out of reach, or not safe."""
        trial = self.trial
        return trial is not None and not self.complete and not self.has_phase(trial.starts_with)

    def has_phase(self, name: str) -> bool:
        """Return whether a phase of that name began."""
        return any(event.name == PHASE and event.data.get("name") == name for event in self.events)

    def phase(self, name: str, until: str | None = None) -> Recording:
        """Return the part of the recording from the start of a phase to the start of the next one.

        Args:
            name: name of the phase.
            until: name of a later phase, at the beginning of which to end.

        Raises:
            RecordingError: the phase does not exist, or holds no sample.
        """
        starts = [event for event in self.events if event.name == PHASE]
        names = [event.data.get("name") for event in starts]
        if name not in names or (until is not None and until not in names):
            missing = name if name not in names else until
            raise RecordingError(f"the recording has no phase {missing!r}; it has {names}")
        first = names.index(name)
        last = first + 1 if until is None else names.index(until)
        end = starts[last].time if last < len(starts) else np.inf
        part = self.between(starts[first].time, end)
        if part.joints.time.size == 0 or part.imu.time.size == 0:
            raise RecordingError(f"phase {name!r} of the recording holds no sample")
        return part

    def between(self, start: float, end: float) -> Recording:
        """Return samples and events with start <= time < end [s]; the bounds are rounded to nanoseconds as times are."""
        start, end = (float(rounded(np.asarray(bound))) if abs(bound) < LONGEST else bound for bound in (start, end))
        return Recording(
            self.joint_names,
            _part(self.joints, start, end),
            _part(self.imu, start, end),
            None if self.commands is None else _part(self.commands, start, end),
            tuple(event for event in self.events if start <= event.time < end),
        )

    @classmethod
    def concatenate(cls, parts: Sequence[Recording]) -> Recording:
        """Join consecutive recordings; a stream that one part lacks is missing in the whole."""
        if not parts:
            raise RecordingError("no recordings to concatenate")
        for part in parts:
            if part.joint_names != parts[0].joint_names:
                raise RecordingError(
                    f"recordings of different joints cannot be joined: {', '.join(parts[0].joint_names)}, and "
                    f"{', '.join(part.joint_names)}"
                )
        commands = [part.commands for part in parts if part.commands is not None]
        return cls(
            parts[0].joint_names,
            _joined([part.joints for part in parts]),
            _joined([part.imu for part in parts]),
            _joined(commands) if len(commands) == len(parts) else None,
            tuple(event for part in parts for event in part.events),
        )


def _validated_time(stream: Any, kind: str) -> int:
    time = _own(stream.time)
    if time.ndim != 1:
        raise RecordingError(f"{kind} times have shape {time.shape}; they must be one-dimensional")
    wrong = ~(np.abs(time) < LONGEST)
    on_grid = rounded(time[~wrong])
    if not np.array_equal(on_grid, time[~wrong]):  # times of a part are on the grid already and stay shared
        time = np.array(time)
        time[~wrong] = on_grid
    wrong[1:] |= time[1:] <= time[:-1]
    if wrong.any():
        first = int(np.argmax(wrong))
        after = f" after {time[first - 1]:g} s" if first else ""
        raise RecordingError(
            f"{kind} times must be finite and increasing; sample {first} is at {time[first]:g} s{after}"
        )
    time.setflags(write=False)
    object.__setattr__(stream, "time", time)
    return time.size


def _columns(array: FloatArray) -> int:
    return np.shape(array)[-1] if np.ndim(array) else 0


def _validate(stream: Any, kind: str, name: str, shape: tuple[int, ...], required: bool) -> None:
    value = getattr(stream, name)
    if value is None and not required:
        return
    array = _own(value)
    if array.shape != shape:
        raise RecordingError(f"{kind} {name} has shape {array.shape}; expected {shape}")
    if not np.isfinite(array).all():
        first = int(np.argmax(~np.isfinite(array).all(axis=1)))
        raise RecordingError(f"{kind} {name} is not finite at sample {first} (t = {stream.time[first]:.3f} s)")
    array.setflags(write=False)
    object.__setattr__(stream, name, array)


def _own(value: Any) -> FloatArray:
    """Return the array itself if it and its base are read-only, else a copy: parts of recordings share samples."""
    part = value
    while isinstance(part, np.ndarray) and not part.flags.writeable:
        part = cast("Any", part.base)
    return value if part is None and value.dtype == float else np.array(value, dtype=float)


def read_only(array: FloatArray) -> FloatArray:
    """Make an array read-only and return it, so that a stream takes it without a copy."""
    array.setflags(write=False)
    return array


def _part(stream: _Stream, start: float, end: float) -> _Stream:
    """Return the samples of a stream with start <= time < end [s]."""
    part = slice(*np.searchsorted(stream.time, [start, end]))
    cut: dict[str, Any] = {name: None if array is None else array[part] for name, array in vars(stream).items()}
    return type(stream)(**cut)


def _joined(streams: Sequence[_Stream]) -> _Stream:
    """Return consecutive streams as one; an array that one of them lacks is missing in the whole."""
    joined: dict[str, Any] = {}
    for name in vars(streams[0]):
        parts = [getattr(stream, name) for stream in streams]
        joined[name] = None if any(part is None for part in parts) else read_only(np.concatenate(parts))
    return type(streams[0])(**joined)
