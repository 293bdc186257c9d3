"""Streams of an external log, and their conversion to one `Recording`.

A reader (rosbag.py, tables/) returns a `RawLog`. `assemble` maps its joints, drops invalid samples, puts all streams on one
clock that starts at zero, and collects findings.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.errors import RecordingError
from equipoise.logs.finding import LogFinding
from equipoise.logs.joint_names import JointMap, map_joints
from equipoise.logs.motions.loads import FootLoads
from equipoise.logs.orientation import angular_velocity_of
from equipoise.logs.repeats import increasing, repeated_rows
from equipoise.recording.recording import CommandStream, ImuStream, JointStream, Recording, read_only
from equipoise.robot.floor import floor_normals_by_fit
from equipoise.robot.kinematics import foot_positions
from equipoise.robot.model import RobotModel

_MOST_BAD = 0.05  # of a stream's samples: more is not packet loss but another kind of file
_LEAST_OVERLAP = 1.0  # [s] of joints and IMU together
_SLOWEST = 20.0  # [Hz]


@dataclass(frozen=True, eq=False)
class RawJoints:
    """Joint samples or commands as a log has them.

    Attributes:
        time: (n,) stamps, from the log's own origin [s].
        names: (k,) names of the columns.
        position: (n, k) joint positions [rad].
        velocity, torque: (n, k) joint velocities and torques, or None [rad/s], [Nm].
        foot_force: (n, 4) readings of the foot force sensors FL FR RL RR, in any unit, or None.
    """

    time: FloatArray
    names: tuple[str, ...]
    position: FloatArray
    velocity: FloatArray | None = None
    torque: FloatArray | None = None
    foot_force: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class RawImu:
    """IMU samples as a log has them.

    Attributes:
        time: (n,) stamps [s].
        angular_velocity_in_imu: (n, 3) angular velocity [rad/s], or None if the log has only an orientation.
        acceleration_in_imu: (n, 3) specific force [m/s2], or None.
        quat_wxyz: (n, 4) fused orientation of the IMU in the world, or None; used where there is no angular velocity.
        pose_noise: (n, 2) noise of the poses that the samples are derived from, as in `ImuStream`, or None.
    """

    time: FloatArray
    angular_velocity_in_imu: FloatArray | None
    acceleration_in_imu: FloatArray | None
    quat_wxyz: FloatArray | None = None
    pose_noise: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class RawLog:
    """Streams of a log, as its reader found them.

    Attributes:
        joints, imu, commands: streams of the log; the IMU is None if the log has none.
        about: topics, columns and stamps that the streams are from, for display.
        findings: findings of the reader.
        joint_map: joint map, if the log's format determines it.
    """

    joints: RawJoints
    imu: RawImu | None
    commands: RawJoints | None = None
    about: Mapping[str, str] = field(default_factory=dict[str, str])
    findings: tuple[LogFinding, ...] = ()
    joint_map: JointMap | None = None


@dataclass(frozen=True, eq=False)
class Log:
    """A log as the robot's own recording.

    Attributes:
        recording: recording without events; time zero is the first sample.
        joint_map: map from the robot's joints to the log's.
        about: topics, columns and stamps that the streams are from.
        findings: findings of reader and conversion.
        foot_forces: readings of the foot force sensors, or None.
    """

    recording: Recording
    joint_map: JointMap
    about: Mapping[str, str]
    findings: tuple[LogFinding, ...]
    foot_forces: FootLoads | None = None


def assemble(
    robot: RobotModel,
    raw: RawLog,
    given: Mapping[str, str | int] | None = None,
    span: tuple[float | None, float | None] = (None, None),
    standing: bool = False,
) -> Log:
    """Return the recording that a raw log holds.

    Args:
        given: joint map of the user.
        span: start and end of what is read, after the log's first sample [s].
        standing: True for a log of a standing robot, which may be one sample, without an IMU.

    Raises:
        RecordingError: joints cannot be identified, streams do not overlap, or too many samples are invalid.
        SettingsError: the user's joint map does not fit.
    """
    findings = list(raw.findings)
    joint_map = raw.joint_map if raw.joint_map is not None and not given else map_joints(robot, raw.joints.names, given)
    if raw.imu is None and not standing:
        raise RecordingError("the log has no IMU: log the raw accelerometer and gyroscope")
    origin = min(_first(stream.time) for stream in (raw.joints, raw.imu) if stream is not None)
    start, end = origin + (span[0] or 0.0), np.inf if span[1] is None else origin + span[1]
    joints = _joint_stream(raw.joints, joint_map.columns, origin, (start, end), findings)
    if raw.imu is None:
        findings.append(LogFinding("IMU", "the log has none: the plane of the feet is taken for level"))
        imu = _level_imu(robot, joints)
    else:
        imu = _imu_stream(raw.imu, origin, (start, end), findings)
    commands = _commands(raw.commands, joint_map, origin, (start, end), findings)
    recording, about = Recording(robot.joint_names, joints, imu, commands), dict(raw.about)
    if not standing:
        _check_overlap(joints.time, imu.time)
        _check_rate("joint", joints.time)
        _check_rate("IMU", imu.time)
        about["rates"] = f"joints {rate(joints.time):.0f} Hz, IMU {rate(imu.time):.0f} Hz"
    return Log(recording, joint_map, about, tuple(findings), _foot_forces(raw.joints, origin))


def rate(time: FloatArray) -> float:
    """Return the median sample rate, which gaps do not affect [Hz]."""
    return 1 / float(np.median(np.diff(time))) if len(time) > 1 else 0.0


def _first(time: FloatArray) -> float:
    finite = time[np.isfinite(time)]
    if not finite.size:
        raise RecordingError("the log holds no sample with a time stamp")
    return float(finite.min())


def _joint_stream(
    raw: RawJoints, columns: NDArray[np.intp], origin: float, span: tuple[float, float], findings: list[LogFinding]
) -> JointStream:
    rows = _rows_of_legs(raw, columns, findings)
    time, position = raw.time[rows], _taken(raw.position, rows, columns)
    velocity = _measured(raw.velocity, rows, columns, "velocities", findings)
    torque = _measured(raw.torque, rows, columns, "torques", findings)
    kept = _kept("joint", time, [part for part in (position, velocity, torque) if part is not None], span, findings)
    others = (None if part is None else _taken(part, kept) for part in (velocity, torque))
    return JointStream(time[kept] - origin, _taken(position, kept), *others)


def _foot_forces(raw: RawJoints, origin: float) -> FootLoads | None:
    """Return the readings of the foot force sensors; None without them, or if they never change."""
    if raw.foot_force is None:
        return None
    kept = increasing(np.where(np.isfinite(raw.foot_force).all(axis=1), raw.time, np.nan))
    force = np.asarray(raw.foot_force[kept], dtype=float)
    if len(force) < 2 or not np.ptp(force, axis=0).any():
        return None
    return FootLoads("foot forces", raw.time[kept] - origin, force)


def _taken(values: FloatArray, rows: NDArray[np.intp], columns: NDArray[np.intp] | None = None) -> FloatArray:
    """Return some rows and columns of a table; the table itself if those are all, since logs are too large to copy."""
    if columns is not None and columns.tolist() != list(range(values.shape[1])):
        return read_only(values[rows[:, None], columns])
    return values if len(rows) == len(values) else read_only(values[rows])


def _rows_of_legs(raw: RawJoints, columns: NDArray[np.intp], findings: list[LogFinding]) -> NDArray[np.intp]:
    """Return the samples with any of the legs' joints: an arm may share the topic."""
    there = ~np.isnan(raw.position)[:, columns]
    rows = np.flatnonzero(there.any(axis=1))
    if not rows.size:
        raise RecordingError("the log holds no sample of the legs' joints")
    partial = ~there[rows].all(axis=1)
    if partial.mean() > _MOST_BAD:
        first = there[rows[int(np.argmax(partial))]]
        absent = [raw.names[int(column)] for column in columns[~first]]
        raise RecordingError(
            f"{partial.mean():.0%} of the joint samples hold only some of the legs' joints (the first lacks "
            f"{', '.join(absent)}): a sample must hold all of them"
        )
    if len(rows) < len(there):
        findings.append(LogFinding("joints", f"{len(there) - len(rows)} samples are of other joints: left out"))
    return rows


def _measured(
    values: FloatArray | None, rows: NDArray[np.intp], columns: NDArray[np.intp], what: str, findings: list[LogFinding]
) -> FloatArray | None:
    """Return a quantity that not every driver reports: None if it is missing, not a number, or zero throughout."""
    if values is None:
        instead = ": they are taken from the positions" if what == "velocities" else ""
        findings.append(LogFinding("joints", f"the log has no joint {what}{instead}"))
        return None
    chosen = _taken(values, rows, columns)
    bad = ~np.isfinite(chosen).all(axis=1)
    if bad.mean() > _MOST_BAD:
        findings.append(
            LogFinding("joints", f"joint {what} are not numbers in {bad.mean():.0%} of the samples: not used")
        )
        return None
    if not any_numbers(chosen):
        findings.append(LogFinding("joints", f"joint {what} are zero throughout: treated as not measured"))
        return None
    return chosen


def _imu_stream(raw: RawImu, origin: float, span: tuple[float, float], findings: list[LogFinding]) -> ImuStream:
    if raw.acceleration_in_imu is None or not any_numbers(raw.acceleration_in_imu):
        raise RecordingError(
            "the log has no accelerometer. A fused orientation gives the vertical, not the specific force while the body "
            "tips, which a lift needs: log the raw accelerometer, with gravity, or the position of the base by motion capture"
        )
    values = [_angular_velocity(raw, raw.acceleration_in_imu, findings), raw.acceleration_in_imu]
    kept = _kept("IMU", raw.time, values, span, findings)
    if len(kept) > 1:
        repeated = repeated_rows([part[kept] for part in values])
        if repeated.any():
            message = f"{repeated.mean():.0%} of the IMU samples repeat the last one, as if written faster than read: left out"
            findings.append(LogFinding("IMU", message))
            kept = kept[~repeated]
    noise = None if raw.pose_noise is None else _taken(raw.pose_noise, kept)
    return ImuStream(raw.time[kept] - origin, *(_taken(part, kept) for part in values), pose_noise=noise)


def _level_imu(robot: RobotModel, joints: JointStream) -> ImuStream:
    """Return the readings of an IMU on a robot at rest on a level floor."""
    up, _ = floor_normals_by_fit(np.array([foot_positions(robot, position) for position in joints.position]))
    force = GRAVITY * up @ np.array(robot.imu_in_base.rotation)
    return ImuStream(joints.time, np.zeros_like(force), force)


def _angular_velocity(raw: RawImu, acceleration_in_imu: FloatArray, findings: list[LogFinding]) -> FloatArray:
    """Return the gyroscope's angular velocity, or that of the orientation."""
    gyroscope = raw.angular_velocity_in_imu
    if gyroscope is not None and any_numbers(gyroscope):
        return gyroscope
    if raw.quat_wxyz is None:
        if gyroscope is None:
            raise RecordingError("the log has neither gyroscope nor orientation, and needs one: log the raw gyroscope")
        return gyroscope  # of zeros, or no numbers: reported by the later checks
    message = (
        "the log has none: the angular velocity is derived from the fused orientation, which a filter has smoothed and "
        "delayed. The intervals include its noise, not the filter's error. Log the raw gyroscope"
    )
    findings.append(LogFinding("gyroscope", message))
    return angular_velocity_of(raw.time, raw.quat_wxyz, acceleration_in_imu)


def any_numbers(values: FloatArray) -> bool:
    """Return whether there is a finite number other than zero."""
    return bool((np.isfinite(values) & (values != 0)).any())


def _commands(
    raw: RawJoints | None, joint_map: JointMap, origin: float, span: tuple[float, float], findings: list[LogFinding]
) -> CommandStream | None:
    """Return the commands, or None with a finding if they do not fit: they only help to detect frozen encoders."""
    if raw is None:
        return None
    names = [match.log_joint for match in joint_map.matches]
    if not set(names) <= set(raw.names):
        findings.append(LogFinding("commands", "they name other joints than the joint states: not used"))
        return None
    columns = np.array([raw.names.index(name) for name in names], dtype=np.intp)
    position = _taken(raw.position, np.arange(len(raw.position)), columns)
    try:
        kept = _kept("command", raw.time, [position], span, findings)
    except RecordingError as error:
        findings.append(LogFinding("commands", f"not used: {error}"))
        return None
    return CommandStream(raw.time[kept] - origin, _taken(position, kept))


def _kept(
    name: str, time: FloatArray, values: Sequence[FloatArray], span: tuple[float, float], findings: list[LogFinding]
) -> NDArray[np.intp]:
    """Return the indices of the valid samples: numbers, with stamps that increase.

    Raises:
        RecordingError: there are none, or too many that cannot be used.
    """
    index = np.flatnonzero(~np.isfinite(time) | ((time >= span[0]) & (time <= span[1])))
    if not index.size:
        raise RecordingError(f"the log holds no {name} sample within the requested time: check --from and --until")
    finite = np.all([np.isfinite(part).all(axis=1) for part in values], axis=0)
    broken = ~np.isfinite(time[index]) | ~finite[index]
    if broken.mean() > _MOST_BAD:
        raise RecordingError(
            f"{broken.mean():.0%} of the {name} samples are not numbers, the first at sample {int(np.argmax(broken))}: "
            f"at most {_MOST_BAD:.0%} may fail; check the sensor"
        )
    if broken.any():
        findings.append(LogFinding(name, f"{broken.sum()} of {len(index)} {name} samples are not numbers: left out"))
    index = index[~broken]
    latest = np.maximum.accumulate(time[index])
    late = np.concatenate([[False], time[index][1:] <= latest[:-1]])
    if late.mean() > _MOST_BAD:
        first = int(np.argmax(late))
        back = float((latest[:-1] - time[index][1:]).max())
        several = "are these several logs in one, or several publishers on one topic? Cut with --from and --until"
        raise RecordingError(
            f"{late.mean():.0%} of the {name} stamps do not increase, from sample {first} on, and go back by as much as "
            f"{back:.3g} s: {several if back else 'are they whole seconds, without the column of the rest?'}"
        )
    if late.any():
        message = f"{late.sum()} of {len(index)} {name} samples have stamps that repeat or go back: left out"
        findings.append(LogFinding(name, message))
    return index[~late]


def _check_rate(name: str, time: FloatArray) -> None:
    if rate(time) < _SLOWEST:
        raise RecordingError(
            f"{name} samples come at {rate(time):.3g} Hz, or their stamps are not in seconds: at least {_SLOWEST:.0f} Hz are "
            "needed; 100 Hz and more are usual"
        )


def _check_overlap(joints: FloatArray, imu: FloatArray) -> None:
    overlap = min(joints[-1], imu[-1]) - max(joints[0], imu[0])
    if overlap < _LEAST_OVERLAP:
        raise RecordingError(
            f"joint samples are from {joints[0]:.2f} to {joints[-1]:.2f} s, IMU samples from {imu[0]:.2f} to {imu[-1]:.2f} s: "
            f"they share {max(overlap, 0.0):.2f} s. Are the stamps from one clock, and is the whole log in the file?"
        )
