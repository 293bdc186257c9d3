"""Screening of the sensors before an estimate.

Each sensor is compared with another that measures the same: encoders with commands, joint velocities with encoders, the
gyroscope with the rotation of the accelerometer's vertical. Last, the plane through all four feet is the floor, which is
nearly level: its normal from the encoders must agree with the accelerometer's vertical in every posture. Where they
disagree, the usual mistakes are undone one by one, and the error names the one that restores agreement.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.spatial.transform import Rotation

from equipoise.conventions import ACCELERATION_AT_REST, AT_REST_IN_UNITS_OF_G, GRAVITY, FloatArray
from equipoise.errors import MotionError, RecordingError
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.measurements.lift_samples import attitudes
from equipoise.recording.encoder_steps import frozen_travel, smallest_steps
from equipoise.recording.gaps import split_at_gaps
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.recording.runs import true_runs
from equipoise.result.findings import Check
from equipoise.robot.floor import floor_normals_by_fit
from equipoise.robot.kinematics import foot_jacobians
from equipoise.robot.model import LEG_NAMES, RobotModel
from equipoise.robot.statics import PLAUSIBLE_LOAD

_BEYOND_LIMIT = 1.0  # [rad]: more than any joint offset or hard stop explains
_FROZEN_TIME = 0.15  # [s] of identical samples
_FROZEN_MOVE = 0.02  # [rad] that was commanded meanwhile; more with coarse encoders
_VELOCITY_BLOCK = 0.04  # [s]: short against motions, and encoder noise over it is small
_VELOCITY_MOVE = 1e-3  # [rad] rms per block below which a joint did not move enough for a comparison
_VELOCITY_ERROR = 0.5  # of the motion, rms: at most 0.09 in fault-free runs, 1.4 where ODE pushes feet out of the floor
_VELOCITY_STILL = 5e-3  # [rad] rms per block that counts as motion at least: encoders of 10 bits at rest
_VELOCITY_RATIO = (0.6, 1.6)  # of reported velocity over the encoder's; delays and filters remove a tenth
# Larger angles are not sensor noise: errors of floors, joint offsets and IMUs add up to 5 to 10 mrad.
_DISAGREEMENT = 0.06  # [rad], rms
_SUSPICIOUS = 0.025  # [rad], if undoing a usual mistake removes it: that does not remove noise
_CURED = 0.35  # largest share of the disagreement that remains when the mistake is undone
_TURNED = np.radians(12)  # more than the slope of a floor
_RIGHT_ANGLE = np.radians(10)  # IMUs are mounted at right angles, within about this angle
_FEWEST_RESTS = 4

_Moves = tuple[FloatArray, FloatArray]
"""Changes (n, nj) of the encoders over short blocks, and integrals of the reported velocities over them [rad]."""

GYROSCOPE_MISTAKES: tuple[tuple[str, FloatArray], ...] = (
    ("is it in degrees per second?", np.full(3, np.pi / 180)),
    ("do all axes have the wrong sign?", -np.ones(3)),
    *((f"does its {axis} have the wrong sign?", 1 - 2 * np.eye(3)[index]) for index, axis in enumerate("xyz")),
)
"""Usual mistakes as questions, and the (3,) factors that undo them."""


RIGHT_ANGLE_TURNS = tuple(turn for turn in Rotation.create_group("O").as_matrix().round() if np.trace(turn) < 3)
"""All 23 (3, 3) rotations by right angles except the identity: possible mountings of an IMU."""


def screen(robot: RobotModel, recordings: Sequence[Recording]) -> Check:
    """Raise for sensor data that no estimate can use; return the check of the joint velocities.

    Raises:
        RecordingError: a frozen encoder, degrees instead of radians, g instead of m/s2, a sensor with the wrong sign, swapped
            legs, torques that do not carry the robot.
        MotionError: the IMU is mounted rotated.
    """
    moves = _moves(recordings)
    velocities = _velocity_check(robot, moves)
    rests = [recording.phase(Phase.REST) for recording in recordings if recording.has_phase(Phase.REST)]
    if not rests:
        return velocities
    position = np.array([rest.joints.position.mean(axis=0) for rest in rests])
    acceleration = np.array([rest.imu.acceleration_in_imu.mean(axis=0) for rest in rests])
    _check_gravity(acceleration)
    _check_radians(robot, position)
    for recording in recordings:
        _check_frozen(recording)
    _check_velocity(robot, moves)
    _check_gyroscope(recordings)
    if len(rests) >= _FEWEST_RESTS:
        _check_floor(robot, position, acceleration)
    with_torque = np.array([rest.joints.torque is not None for rest in rests])
    if with_torque.any():
        measured = [rest.joints.torque.mean(axis=0) for rest in rests if rest.joints.torque is not None]
        _check_torques(robot, position[with_torque], np.array(measured), acceleration[with_torque])
    return velocities


def screen_log(robot: RobotModel, log: Recording) -> None:
    """Raise for wrong units or dead sensors in a whole log, before it is searched for motions.

    Raises:
        RecordingError: degrees instead of radians, g instead of m/s2, a dead gyroscope or encoder, wrong velocities.
    """
    _check_gravity(log.imu.acceleration_in_imu)
    if not np.ptp(log.imu.angular_velocity_in_imu, axis=0).any():
        raise RecordingError("the gyroscope's readings are the same in the whole log: log its angular velocities")
    # Quantiles, because single samples may be glitches.
    levels = [np.quantile(position, (0.05, 0.5, 0.95)) for position in log.joints.position.T]
    _check_radians(robot, np.column_stack(levels))
    _check_frozen(log)
    _check_velocity(robot, _moves([part for part, _ in split_at_gaps(log)]))


def _check_gravity(acceleration: FloatArray) -> None:
    size = float(np.median(np.linalg.norm(acceleration, axis=1)))
    if not ACCELERATION_AT_REST[0] < size < ACCELERATION_AT_REST[1]:
        in_g = AT_REST_IN_UNITS_OF_G[0] < size < AT_REST_IN_UNITS_OF_G[1]
        unit = " (is it in units of g?)" if in_g else ""
        raise RecordingError(f"the accelerometer reads {size:.3g} at rest; it must read about {GRAVITY} m/s2{unit}")


def _check_radians(robot: RobotModel, position: FloatArray) -> None:
    def beyond(position: FloatArray) -> FloatArray:
        return np.maximum(robot.lower_limit - position, position - robot.upper_limit).max(axis=0)

    worst = int(np.argmax(beyond(position)))
    if beyond(position)[worst] <= _BEYOND_LIMIT:
        return
    hint = ""
    if np.abs(position).max() > 2 * np.pi:
        hint = " (are joint positions in degrees?)"
    elif beyond(-position)[worst] <= 0:
        hint = " (does it have the wrong sign?)"
    raise RecordingError(
        f"joint {robot.joint_names[worst]!r} reads {position[:, worst].mean():.2f}; its limits are "
        f"{robot.lower_limit[worst]:.2f} to {robot.upper_limit[worst]:.2f} rad{hint}"
    )


def _check_frozen(recording: Recording) -> None:
    """Raise if an encoder reads exactly the same while its command moves."""
    joints, commands = recording.joints, recording.commands
    if commands is None or len(joints.time) < 3:
        return
    needed = max(2, round(_FROZEN_TIME / float(np.median(np.diff(joints.time)))))
    travel = frozen_travel(_FROZEN_MOVE, smallest_steps(joints.position))
    for joint in range(joints.position.shape[1]):
        same = np.diff(joints.position[:, joint]) == 0
        for first, last in true_runs(same):
            if last - first < needed:
                continue
            start, end = joints.time[first], joints.time[last]
            commanded = commands.position[(commands.time >= start) & (commands.time <= end), joint]
            if len(commanded) and float(np.ptp(commanded)) > travel[joint]:
                raise RecordingError(
                    f"the encoder of joint {recording.joint_names[joint]!r} is frozen: it reads "
                    f"{joints.position[first, joint]:.4f} rad from t = {start:.2f} s to {end:.2f} s while its command moves "
                    f"by {np.ptp(commanded):.2f} rad; check its power and cable"
                )


def _velocity_check(robot: RobotModel, moves: _Moves | None) -> Check:
    """Test that integrals of reported velocities over short blocks follow the encoders, in motion and at rest.

    Some simulators push penetrating bodies apart without reporting that motion: joints that rest report a velocity.
    """
    name = "joint velocities"
    if moves is None:
        return Check(name, True, "not tested: the recordings contain no joint velocities")
    by_encoder, by_velocity = moves
    size = np.hypot(np.sqrt(np.mean(by_encoder**2, axis=0)), _VELOCITY_STILL)
    shares = np.sqrt(np.mean((by_velocity - by_encoder) ** 2, axis=0)) / size
    worst = int(np.argmax(shares))
    passed = bool(shares[worst] < _VELOCITY_ERROR)
    message = (
        f"integrals of the velocity of joint {robot.joint_names[worst]!r} differ from its encoder by "
        f"{shares[worst]:.0%} of the motion (limit {_VELOCITY_ERROR:.0%})"
    )
    if not passed:
        message += (
            ". The gyroscope may be as wrong. In Gazebo, damp the feet (kd) or use the solver 'world'; on a robot, check how "
            "the driver measures velocities, or leave them out of the recordings"
        )
    return Check(name, passed, message)


def _moves(recordings: Sequence[Recording]) -> _Moves | None:
    """Return the moves of all recordings; None if none has velocities."""
    moved: list[FloatArray] = []
    integrated: list[FloatArray] = []
    for recording in recordings:
        joints = recording.joints
        if joints.velocity is None or len(joints.time) < 3:
            continue
        block = max(1, round(_VELOCITY_BLOCK / float(np.median(np.diff(joints.time)))))
        # One joint at a time, to save memory.
        paths = [cumulative_trapezoid(velocity, joints.time, initial=0)[::block] for velocity in joints.velocity.T]
        moved.append(np.diff(joints.position[::block], axis=0))
        integrated.append(np.diff(np.column_stack(paths), axis=0))
    return (np.concatenate(moved), np.concatenate(integrated)) if moved else None


def _check_velocity(robot: RobotModel, moves: _Moves | None) -> None:
    """Raise if velocities are not the encoders' rates in rad/s."""
    if moves is None:
        return
    by_encoder, by_velocity = moves
    power = np.mean(by_encoder**2, axis=0)
    ratio = np.mean(by_encoder * by_velocity, axis=0) / np.maximum(power, _VELOCITY_MOVE**2)
    wrong = (power > _VELOCITY_MOVE**2) & ~((ratio > _VELOCITY_RATIO[0]) & (ratio < _VELOCITY_RATIO[1]))
    if wrong.any():
        worst = int(np.argmax(np.where(wrong, np.abs(ratio - 1), 0.0)))
        hint = " (is it in degrees per second?)" if 45 < ratio[worst] < 70 else ""
        hint = " (are joint positions in degrees?)" if 1 / 70 < ratio[worst] < 1 / 45 else hint
        hint = " (does one of them have the wrong sign?)" if ratio[worst] < -0.5 else hint
        raise RecordingError(
            f"the velocity of joint {robot.joint_names[worst]!r} is {ratio[worst]:.2g} times the rate of its encoder; "
            f"it must be in rad/s{hint}"
        )


def _check_gyroscope(recordings: Sequence[Recording]) -> None:
    """Raise if the rotations between two rests from gyroscope and accelerometer differ."""
    moves = [
        recording for recording in recordings if recording.has_phase(Phase.BEFORE) and recording.has_phase(Phase.REST)
    ]
    if not moves:
        return
    rests = [(move.phase(Phase.BEFORE).imu, move.phase(Phase.REST).imu) for move in moves]
    bias = np.median([after.angular_velocity_in_imu.mean(axis=0) for _, after in rests], axis=0)

    def disagreement(factor: FloatArray) -> float:
        angles: list[float] = []
        for move, (before, after) in zip(moves, rests, strict=True):
            imu = move.between(before.time[0], after.time[0]).imu
            path = attitudes(imu.time, (imu.angular_velocity_in_imu - bias) * factor)
            first, last = before.acceleration_in_imu.mean(axis=0), after.acceleration_in_imu.mean(axis=0)
            cosine = first @ path.as_matrix()[-1] @ last / np.linalg.norm(first) / np.linalg.norm(last)
            angles.append(float(np.arccos(np.clip(cosine, -1, 1))))
        return float(np.sqrt(np.mean(np.square(angles))))

    now = disagreement(np.ones(3))
    if now < _DISAGREEMENT:
        return
    left, what = min((disagreement(factor), what) for what, factor in GYROSCOPE_MISTAKES)
    hint = what if left < _CURED * now else "are their axes the same?"
    raise RecordingError(
        f"rotations of the robot from gyroscope and accelerometer differ by {np.degrees(now):.0f} deg: the gyroscope must be "
        f"in rad/s, in the accelerometer's axes ({hint})"
    )


def _check_torques(robot: RobotModel, position: FloatArray, torque: FloatArray, acceleration: FloatArray) -> None:
    """Raise if the joint torques do not carry the weight; internal forces between the legs do not contribute to it."""
    up = acceleration @ np.array(robot.imu_in_base.rotation).T
    inverse = np.linalg.pinv([foot_jacobians(robot, row) for row in position])
    velocity = -np.einsum("nlji,ni->nlj", inverse, up)  # of joints that raise the base
    weight = np.einsum("nlj,nlj->n", torque[:, robot.leg_joints], velocity)
    mass = float(np.median(weight / np.einsum("ni,ni->n", up, up)))
    if not PLAUSIBLE_LOAD[0] * robot.mass < mass < PLAUSIBLE_LOAD[1] * robot.mass:
        hint = (
            "do they have the wrong sign?"
            if mass < -PLAUSIBLE_LOAD[0] * robot.mass
            else "are they those of the joints, in Nm?"
        )
        raise RecordingError(
            f"at rest the joint torques carry {mass:.3g} kg, but the model weighs {robot.mass:.3g} kg: {hint} Leave torques "
            "out of the recordings if the robot does not measure them"
        )


def _check_floor(robot: RobotModel, position: FloatArray, acceleration: FloatArray) -> None:
    legs = LegChains(robot)
    up = acceleration @ np.array(robot.imu_in_base.rotation).T
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    feet = legs.feet(position)
    now = _disagreement(feet, up)
    if now < _SUSPICIOUS:
        return
    turn, _ = Rotation.align_vectors(floor_normals_by_fit(feet)[0], up)
    if _disagreement(feet, turn.apply(up)) < _CURED * now:
        if now < _DISAGREEMENT:
            return  # a tilt that the estimate corrects
        doubt = "" if turn.magnitude() > _TURNED else ", or the floor slopes as much"
        observed = (
            f"the vertical of the accelerometer and of the floor through the feet differ by {np.degrees(now):.0f} deg"
        )
        raise imu_mounting_error(robot, turn.as_matrix(), observed, doubt)
    left, what = min((_disagreement(legs.feet(cured), up), what) for what, cured in _mistakes(robot, legs, position))
    if left >= _CURED * now:
        if now < _DISAGREEMENT:
            return
        without = [_disagreement(np.delete(feet, leg, axis=1), up) for leg in range(len(LEG_NAMES))]
        leg = int(np.argmin(without))
        which = f" of {LEG_NAMES[leg]}" if without[leg] < _CURED * now else ""
        what = f"an encoder{which}, or the model of the legs, is wrong"
    raise RecordingError(
        f"the vertical of the accelerometer and of the floor through the feet differ by {np.degrees(now):.0f} deg: {what}"
    )


def imu_mounting_error(robot: RobotModel, turn: FloatArray, observed: str, doubt: str = "") -> MotionError:
    """Return the error for an IMU that is rotated by (3, 3) from its orientation in the model.

    Args:
        observed: observation that shows it.
        doubt: other possible cause.
    """
    roll, pitch, yaw = _mounting(robot, turn)
    return MotionError(
        f"{observed}: the IMU is mounted rotated by roll {roll:.0f}, pitch {pitch:.0f}, yaw {yaw:.0f} deg relative to the "
        f"base{doubt}; set imu_rpy in a robot configuration"
    )


def _mounting(robot: RobotModel, turn: FloatArray) -> tuple[float, float, float]:
    """Return roll, pitch and yaw in the base [deg] of an IMU that is rotated by (3, 3) from its orientation in the model."""
    nearest = max(RIGHT_ANGLE_TURNS, key=lambda matrix: float(np.trace(matrix.T @ turn)))
    if np.trace(nearest.T @ turn) > 1 + 2 * np.cos(_RIGHT_ANGLE):
        turn = nearest
    matrix = turn @ np.array(robot.imu_in_base.rotation)
    # SciPy's angles warn at a pitch of 90 deg, where roll can be set to zero.
    level = float(np.hypot(matrix[0, 0], matrix[1, 0]))
    pitch = np.arctan2(-matrix[2, 0], level)
    if level < 1e-6:
        roll, yaw = 0.0, np.arctan2(-matrix[0, 1], matrix[1, 1])
    else:
        roll, yaw = np.arctan2(matrix[2, 1], matrix[2, 2]), np.arctan2(matrix[1, 0], matrix[0, 0])
    degrees = np.degrees([roll, pitch, yaw]) + 0.0  # no minus zero
    return float(degrees[0]), float(degrees[1]), float(degrees[2])


def _mistakes(robot: RobotModel, legs: LegChains, position: FloatArray) -> list[tuple[str, FloatArray]]:
    """Return usual mistakes and the (n, nj) joint positions without them [rad]."""
    found: list[tuple[str, FloatArray]] = []

    def flip(what: str, joints: Sequence[int]) -> None:
        flipped = position.copy()
        flipped[:, joints] *= -1
        found.append((f"{what} the wrong sign", flipped))

    def swap(what: str, pairs: Sequence[tuple[int, int]]) -> None:
        order = list(LEG_NAMES)
        for a, b in pairs:
            order[a], order[b] = order[b], order[a]
        found.append((f"the legs {what} seem to be swapped", in_order_of_legs(robot, position, order)))

    for joint, name in enumerate(robot.joint_names):
        flip(f"joint {name!r} seems to have", [joint])
    for place in range(legs.joints.shape[1]):
        for several in ((0, 1), (2, 3), (0, 2), (1, 3), (0, 1, 2, 3)):
            joints = [int(legs.joints[leg, place]) for leg in several]
            flip(f"joints {', '.join(robot.joint_names[joint] for joint in joints)} seem to have", joints)
    for a, b in itertools.combinations(range(4), 2):
        swap(f"{LEG_NAMES[a]} and {LEG_NAMES[b]}", [(a, b)])
    swap("of the left and the right side", [(0, 1), (2, 3)])
    swap("of the front and the rear", [(0, 2), (1, 3)])
    swap("FL and RR, and FR and RL,", [(0, 3), (1, 2)])
    return found


def in_order_of_legs(robot: RobotModel, position: FloatArray, legs: Sequence[str]) -> FloatArray:
    """Return (n, nj) joint positions in which the legs FL FR RL RR have those of the named legs, in this order."""
    reordered = position.copy()
    reordered[:, robot.leg_joints] = position[:, np.array([robot.legs[leg].joints for leg in legs])]
    return reordered


def _disagreement(feet: FloatArray, up: FloatArray) -> float:
    """Return the rms angle of up against the normal of (n, 3 or 4, 3) feet, with the feet's unevenness as an angle [rad]."""
    normal, unevenness = floor_normals_by_fit(feet)
    cosine: FloatArray = np.asarray(np.einsum("ni,ni->n", normal, up), dtype=float)
    angle = np.arccos(np.clip(cosine, -1, 1))
    return float(np.sqrt(np.mean(angle**2 + unevenness**2)))
