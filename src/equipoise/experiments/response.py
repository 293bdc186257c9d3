"""Response test before any foot is lifted: checks joints with their encoders, and the gyroscope with turns of the base."""

from __future__ import annotations

from collections.abc import Callable, Collection
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pinocchio as pin

from equipoise.conventions import AXES, Axis, FloatArray
from equipoise.errors import MotionError, ReachError
from equipoise.experiments.excitation import feet_during_excitation
from equipoise.experiments.imu_orientation import REST_TIME, Orientation, fit_orientation, wirings
from equipoise.experiments.posture import check_posture
from equipoise.experiments.response_test import ResponseTest
from equipoise.experiments.stand import take_over
from equipoise.experiments.standing_robot import StandingRobot
from equipoise.json_form import to_json
from equipoise.platform.platform import Platform
from equipoise.platform.ramp import smooth_step
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.robot.imu import rpy_flag
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

# Steps of one joint [rad], tried in order until it responds; the guard treats 0.12 rad as stuck.
_STEPS = np.radians((2.0, -2.0, 4.0, -4.0, 6.0, -6.0))
_STEP_TIME, _HOLD_TIME = 0.3, 0.15  # [s]
_RESPONSE = 0.05  # of the commanded angle: less is noise; a leg whose foot the floor blocks moves by a tenth
_LIMP_TIME, _LIMP_TIMES, _STILL = 0.5, 8, 0.01  # period [s], largest number of periods, smallest motion [rad]
_GAINS = (0.02, 0.1, 0.3, 1.0)  # of holds, as a fraction of the usual ones
_YIELD = 0.25  # [rad] largest motion of a joint in a hold
_TURN, _TURN_TIME, _REST_TIME = np.radians(3.0), 0.6, 0.3  # of the base [rad], [s] on an A1
_KNOTS = 5  # of inverse kinematics on a turn
_SMALLER = (1.0, 0.5, 0.25)  # scale factors, tried in order until a turn is within reach
_RESIDUAL, _EXPLAINED = 0.1, 0.05  # largest residual; the same if another wiring explains the gyroscope
_CLEARLY = 0.65  # largest residual of a wiring that explains the gyroscope, over the model's
_ALIKE = 1.5  # largest residual of a wiring that is reported, over the smallest
_NAMED = 3  # largest number of reported wirings
_AGREES = np.radians(5.0)  # between the measured orientation and the model's


def check_joints(platform: Platform, robot: RobotModel, stance: Stance) -> int:
    """Move every joint of a lying robot by 2 deg and back, one after another.

    Returns:
        number of joints that responded, without those that have no room; 0 for a standing robot, which is not moved.

    Raises:
        MotionError: a joint responds with the wrong sign, at another encoder, or not at all.
    """
    standing = take_over(platform, robot, stance)
    if standing.target.legs:
        return 0
    if "gains" in platform.accepts:
        sink(standing)
        standing = take_over(platform, robot, stance)
        for share in _GAINS:
            if refusal := judge_hold(hold(standing, stance, share), standing.target.joint_position):
                raise refusal
    responded = sum(_responds(standing, joint) for joint in range(len(robot.joint_names)))
    standing.take()
    return responded


def _responds(standing: StandingRobot, joint: int) -> bool:
    """Step with one joint, by growing angles to either side, until it responds: the floor may block the foot.

    Returns:
        True if it responded; False if its limits and other links leave it no room.
    """
    robot, here, refusal = standing.robot, standing.target.joint_position[joint], None
    leg = next(leg.joints for leg in robot.legs.values() if joint in leg.joints)
    for angle in _STEPS:
        if not robot.lower_limit[joint] < here + angle < robot.upper_limit[joint]:
            continue
        with suppress(ReachError):  # links would touch
            refusal = judge_step(step_joint(standing, joint, angle), joint, angle, leg)
            if refusal is None:
                return True
    if refusal is not None:
        raise refusal
    return False


def sink(standing: StandingRobot) -> None:
    """Damp the joints without position control until a crouching robot lies on its belly."""
    for _ in range(_LIMP_TIMES):
        moved = standing.play(standing.motion().phase(Phase.LIE).hold_limp(_LIMP_TIME)).joints.position
        if np.abs(moved[-1] - moved[0]).max() < _STILL:
            return


def hold(standing: StandingRobot, stance: Stance, share: float) -> Recording:
    """Hold the joint positions with a fraction of the usual gains: a joint with the wrong sign moves gently."""
    kp, kd = (np.full(len(standing.robot.joint_names), gain) for gain in standing.robot.gains(stance.hip_height))
    return standing.play(standing.motion().with_gains(share * kp, kd).hold(_STEP_TIME))


def judge_hold(recording: Recording, target: FloatArray) -> MotionError | None:
    """Return the error of a robot that did not hold (nj,) joint positions [rad]; None if it did."""
    moved = recording.joints.position[-1] - target
    worst = int(np.argmax(np.abs(moved)))
    if abs(moved[worst]) <= _YIELD:
        return None
    return _refused(recording, worst, 0.0, moved, "the sign or the order of joints is wrong, or the robot was moved")


def step_joint(standing: StandingRobot, joint: int, angle: float) -> Recording:
    """Move one joint by an angle [rad] and back. Phases: before, move, rest, end."""
    motion = standing.motion().phase(Phase.BEFORE).hold(_HOLD_TIME).phase(Phase.MOVE)
    path = np.zeros((round(_STEP_TIME / motion.control_period), len(standing.robot.joint_names)))
    path[:, joint] = angle * smooth_step(len(path))
    motion.swing_joints(path).phase(Phase.REST).hold(_HOLD_TIME)
    return standing.play(motion.phase(Phase.END).swing_joints(path[::-1] - path[-1]))


def judge_step(recording: Recording, joint: int, angle: float, leg: Collection[int] = ()) -> MotionError | None:
    """Return the error of a joint that did not respond to an angle [rad]; None if its encoder moved farthest.

    If the floor blocks the foot, the other joints of its leg, with indices `leg`, may move farther.
    """
    before, during = (recording.phase(name).joints.position for name in (Phase.BEFORE, Phase.REST))
    moved = during[len(during) // 2 :].mean(axis=0) - before.mean(axis=0)
    largest = int(np.argmax(np.abs(moved)))
    if largest in (joint, *leg) and moved[joint] / angle > _RESPONSE:
        return None
    if abs(moved[largest]) < _RESPONSE * abs(angle):
        cause = "no joint responded; its motor is off, or the leg is blocked"
    elif largest != joint:
        cause = f"{recording.joint_names[largest]!r} responded; the order of joints is wrong, or legs are exchanged"
    else:
        cause = "the sign of the joint is wrong"
    return _refused(recording, joint, angle, moved, cause)


def turn_base(standing: StandingRobot, stance: Stance) -> tuple[Recording, tuple[Axis, ...]]:
    """Turn the base of a standing robot by 3 deg about each axis to either side, with all feet on the floor.

    Returns:
        recording with alternating phases rest and move, and the axes about which the base turned.

    Raises:
        ReachError: no turn in roll or pitch is within reach.
    """
    robot, motion = standing.robot, standing.motion().phase(Phase.REST).hold(2 * REST_TIME)
    reachable: dict[Axis, float] = {
        axis: angle for axis in AXES if (angle := _reachable(robot, stance, axis)) is not None
    }
    if not reachable.keys() & {"roll", "pitch"}:
        raise ReachError("the base cannot be turned by 0.75 deg in roll or pitch over its feet: give another stance")
    for axis, angle in reachable.items():
        feet_at = feet_during_excitation(robot, stance, axis)
        share = smooth_step(round(_TURN_TIME * stance.scale.time / motion.control_period))
        for start, end in ((0.0, angle), (angle, -angle), (-angle, 0.0)):
            motion.phase(Phase.MOVE).follow(feet_at, _KNOTS, start + (end - start) * share)
            motion.phase(Phase.REST).hold(_REST_TIME * stance.scale.time)
    recording = standing.play(motion)
    standing.take()
    return recording, tuple(reachable)


def _reachable(robot: RobotModel, stance: Stance, axis: Axis) -> float | None:
    for share in _SMALLER:
        try:
            for side in (share, -share):
                check_posture(robot, stance, feet_during_excitation(robot, stance, axis)(side * _TURN))
        except ReachError:
            continue
        return share * _TURN
    return None


def find_orientation(robot: RobotModel, recording: Recording) -> Orientation:
    """Find the orientation of the IMU from turns of the base.

    Raises:
        MotionError: the gyroscope contradicts the joints; the message lists the wirings that explain it.
    """
    candidates = wirings(robot)
    model = fit_orientation(robot, recording, next(candidates))
    if model.residual <= _EXPLAINED:
        return model
    others = [fit_orientation(robot, recording, wiring) for wiring in candidates]
    best = min(other.residual for other in others)
    explained = best < _CLEARLY * model.residual
    if model.residual <= (_EXPLAINED if explained else _RESIDUAL):
        return model
    alike = sorted((other for other in others if other.residual < _ALIKE * best), key=lambda other: other.residual)
    causes = [f"{other.wiring.cause} (residual {other.residual:.0%})" for other in alike[:_NAMED]]
    likely = (
        " or ".join(causes)
        if explained
        else "a foot slipped or is in the air, or the signs or the order of joints are wrong"
    )
    raise MotionError(
        f"the gyroscope contradicts the joints: the base was turned over four feet, and the residual is {model.residual:.0%} "
        f"of the rotations (limit {_EXPLAINED if explained else _RESIDUAL:.0%}). Likely: {likely}. No foot was lifted. "
        "Correct the joint map, then run 'equipoise doctor'",
        (recording,),
        details={"residual": model.residual, "causes": causes if explained else []},
    )


def check_base(
    standing: StandingRobot, stance: Stance, joints: int, confirm: Callable[[str], bool] | None
) -> ResponseTest:
    """Turn the base over four feet, measure the orientation of the IMU, and use it in the robot model if it is confirmed.

    Args:
        joints: number of joints that responded before.
        confirm: function that asks the operator a question; None without an operator.

    Raises:
        MotionError: the gyroscope contradicts the joints, or the orientation differs from the model's and is not confirmed.
    """
    recording, axes = turn_base(standing, stance)
    found, robot = find_orientation(standing.robot, recording), standing.robot
    measured, model = (_rpy(rotation) for rotation in (found.rotation, robot.imu.placement.rotation))
    test = ResponseTest(joints, axes, found.residual, measured, found.std, model)
    if test.angle <= _AGREES:
        return test
    source = "assumed" if robot.imu.frame is None and "imu_rpy" not in robot.imu.described else robot.imu.message
    message = f"{test.orientation}, {np.degrees(test.angle):.1f} deg from the model's ({source})"
    if confirm is None or not confirm(f"{message}. Is the measured orientation right? It is then used for this run."):
        raise MotionError(
            f"{message}; not confirmed, and no foot was lifted. If the measurement is right, use {rpy_flag(found.rotation)} "
            "(imu_rpy in a robot configuration); if not, examine its mounting",
            (recording,),
            details=to_json(test),
        )
    standing.robot = replace(robot, description=replace(robot.description, imu_rpy=measured))
    return replace(test, uses_measurement=True)


def _rpy(rotation: FloatArray) -> tuple[float, float, float]:
    roll, pitch, yaw = pin.rpy.matrixToRpy(np.array(rotation)).tolist()
    return roll, pitch, yaw


def _refused(recording: Recording, joint: int, commanded: float, moved: FloatArray, cause: str) -> MotionError:
    degrees = {
        name: round(float(angle), 2) for name, angle in zip(recording.joint_names, np.degrees(moved), strict=True)
    }
    return MotionError(
        f"joint {recording.joint_names[joint]!r} was commanded by {np.degrees(commanded):+.1f} deg; encoders moved by "
        f"{', '.join(f'{name} {angle:+.1f}' for name, angle in degrees.items())} deg: {cause}. No foot was lifted. "
        "Correct the joint map, then run 'equipoise doctor'",
        (recording,),
        details={
            "joint": recording.joint_names[joint],
            "commanded": float(np.degrees(commanded)),
            "moved": degrees,
            "cause": cause,
        },
    )
