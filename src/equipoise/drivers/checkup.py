"""Checks of `equipoise doctor`: a few seconds of samples from a robot that is not moved."""

from __future__ import annotations

import time
from collections.abc import Generator
from dataclasses import dataclass
from typing import Any

import numpy as np

from equipoise.conventions import AT_REST_IN_UNITS_OF_G, GRAVITY, WELL_SCALED_ACCELERATION_AT_REST, FloatArray
from equipoise.errors import CommunicationError
from equipoise.platform.platform import Health, JointCommand, Platform, RobotState
from equipoise.platform.stepping import recording_of
from equipoise.recording.recording import Recording
from equipoise.robot.floor import floor_normals_by_fit
from equipoise.robot.imu import upright_flag
from equipoise.robot.kinematics import foot_positions
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import lies, nominal_stance
from equipoise.robot.statics import carried_mass

_PIECE_TIME = 0.25  # [s]
_PATIENCE = 3.0  # [s] with a stopped clock; connections detect silence earlier
_SLOWEST = 100.0  # [Hz] below which a lift is too quick to be sampled
_USUAL = 250.0  # [Hz] below which motion between samples causes height errors of millimetres
_JITTER = 5e-3  # [s]
# Between the floor normal from the encoders and up from the accelerometer: floors, joint offsets and mountings cause less.
_LEAN = np.radians(6)
_LYING_LEAN = np.radians(35)  # for a robot that lies, also on uneven ground
_BEYOND = 0.1  # [rad] of an encoder reading beyond its joint's limits
_BIAS = 0.05  # [rad/s] of a gyroscope at rest
_STILL = 0.06  # [rad/s]
_MASS_RANGE = (0.6, 1.7)  # carried, over the model's
_HOT, _WEAK_BATTERY = 60.0, 0.3  # [deg C], share


@dataclass(frozen=True)
class CheckupFinding:
    """Finding of the doctor.

    Attributes:
        name: name of the quantity that was checked.
        value: value that was measured, in words.
        fine: whether the value is in its range; None: without a range.
        advice: advice, or "".
        serious: whether the robot must not be moved with this finding.
    """

    name: str
    value: str
    fine: bool | None
    advice: str = ""
    serious: bool = False


# No sensor separates an external force from a shifted CoM: 0.15 N shift an A1's by 0.4 mm.
_CABLE = CheckupFinding(
    "cable", "is one attached? No sensor measures its force, which appears as a shifted centre of mass", None,
    "set --cable none without a cable, light (the default) for an Ethernet cable that hangs slack, heavy for "
    "more; --rotate-halfway separates its force from the centre of mass",
)  # fmt: skip


def takeover_findings(source: Any) -> list[CheckupFinding]:
    """Return the findings of a platform or a connection about the first command of `calibrate`.

    A `check_takeover` method is optional; it sends no command, and no controller releases the motors.
    """
    return source.check_takeover() if hasattr(source, "check_takeover") else []


def watch(
    platform: Platform, robot: RobotModel, duration: float | None, arrived: list[float] | None = None
) -> Generator[Recording]:
    """Record a robot that is not moved, in pieces of a quarter of a second.

    A simulated robot holds its stance meanwhile: its time passes only when it is stepped.

    Args:
        duration: time to record [s]; None: until the caller stops.
        arrived: list to which times of arrival are added, on this computer's clock [s].

    Raises:
        CommunicationError: no samples arrive, or the robot's clock does not advance.
    """
    begin = platform.read()
    hold = JointCommand(begin.joint_position)
    states, before = [begin], (-np.inf, -np.inf)
    end = np.inf if duration is None else begin.time + duration
    piece_end = begin.time + _PIECE_TIME
    moved = time.monotonic()
    while states[-1].time < end:
        if begin.received is None:
            state = platform.step(hold)
        else:
            time.sleep(platform.control_period)
            state = platform.read()
        new: list[RobotState] = getattr(platform, "arrived", [state])
        if arrived is not None:
            arrived += [sample.received for sample in new if sample.received is not None]
        if state.time > states[-1].time:
            moved = time.monotonic()
        elif time.monotonic() - moved > _PATIENCE:
            raise CommunicationError(
                f"the robot's time has been {state.time:.6g} s for {_PATIENCE:g} s: its clock has stopped, or no samples "
                "arrive. Is the robot on? With a driver that has the setting tick, tick=0 uses times of arrival"
            )
        states += new
        if state.time >= min(piece_end, end):
            targets = np.array([each.joint_position for each in states])
            sensed = recording_of(robot.joint_names, states, targets, (), np.arange(len(states), dtype=float), before)
            yield Recording(sensed.joint_names, sensed.joints, sensed.imu)  # nothing was sent
            before, states = (float(sensed.joints.time[-1]), float(sensed.imu.time[-1])), states[-1:]
            piece_end += _PIECE_TIME


def examine(platform: Platform, robot: RobotModel, duration: float = 5.0) -> list[CheckupFinding]:
    """Check the samples of a robot that stands or lies still.

    Args:
        platform: platform of the robot; no command is sent to it.
        robot: model of the robot.
        duration: time to record [s].

    Raises:
        CommunicationError: no samples arrive.
    """
    arrived: list[float] = []
    recording = Recording.concatenate(list(watch(platform, robot, duration, arrived)))
    health = platform.read().health
    joints, imu = recording.joints, recording.imu
    position, acceleration_in_imu = joints.position.mean(axis=0), imu.acceleration_in_imu.mean(axis=0)
    findings = [
        _rate("joint samples", joints.time),
        _rate("IMU samples", imu.time),
        *_arrival(np.unique(arrived), imu.time),
        CheckupFinding("joint velocities", "reported" if joints.velocity is not None else "not reported", None),
        *_limits(robot, joints.position),
        _still(imu.angular_velocity_in_imu),
        _gravity(acceleration_in_imu),
        _floor(robot, position, acceleration_in_imu),
        _torque(robot, position, joints.torque),
    ]
    if health is not None:
        findings += _health(robot, health)
    return [*findings, _CABLE]


def joint_table(robot: RobotModel, position: FloatArray) -> list[tuple[str, str, float, float, float]]:
    """Return the platform's joint map: leg, joint, position, lower and upper limit [rad]."""
    return [
        (leg.name, robot.joint_names[index], float(position[index]), float(robot.lower_limit[index]),
         float(robot.upper_limit[index]))
        for leg in robot.legs.values()
        for index in leg.joints
    ]  # fmt: skip


def _judged(name: str, value: str, fine: bool | np.bool_, advice: str, serious: bool = False) -> CheckupFinding:
    """Return a finding, with its advice if it is not fine."""
    return CheckupFinding(name, value, bool(fine), "" if fine else advice, serious)


def _rate(name: str, times: FloatArray) -> CheckupFinding:
    steps = np.diff(times)
    if len(steps) < 2:
        return CheckupFinding(name, f"{len(times)} in total", False, "the sensor does not run")
    rate, longest = 1 / float(np.median(steps)), float(steps.max())
    value = f"{rate:.0f} Hz, jitter {steps.std() * 1000:.2f} ms, longest gap {longest * 1000:.1f} ms"
    fine = rate >= _SLOWEST and float(np.quantile(steps, 0.99)) - float(np.median(steps)) < _JITTER
    if not fine:
        return CheckupFinding(name, value, False, f"lifts are short: use a cable, and at least {_SLOWEST:.0f} Hz")
    if rate < _USUAL:
        advice = f"height errors may exceed their std by millimetres: use {_USUAL:.0f} Hz or more"
        return CheckupFinding(name, value, None, advice)
    return CheckupFinding(name, value, True)


def _arrival(arrived: FloatArray, stamps: FloatArray) -> list[CheckupFinding]:
    """Check the times of arrival: the guard depends on them, not on stamps."""
    if len(arrived) < 3:
        return []
    pauses = np.diff(arrived)
    longest, usual = float(pauses.max()), float(np.median(np.diff(stamps)))
    value = f"jitter {pauses.std() * 1000:.2f} ms, longest pause {longest * 1000:.1f} ms"
    fine = float(np.quantile(pauses, 0.99)) < usual + _JITTER
    return [_judged("arrival", value, fine, "the network delays samples: use a cable")]


def _limits(robot: RobotModel, position: FloatArray) -> list[CheckupFinding]:
    beyond = np.maximum(robot.lower_limit - position.min(axis=0), position.max(axis=0) - robot.upper_limit)
    worst = int(np.argmax(beyond))
    if beyond[worst] <= 0:
        return [CheckupFinding("joint positions", "within the model's limits", True)]
    value = f"{robot.joint_names[worst]} is {beyond[worst]:.2f} rad beyond its limit"
    advice = "check the joint map, signs and joint offsets"
    return [_judged("joint positions", value, beyond[worst] < _BEYOND, advice, serious=True)]


def _still(angular_velocity_in_imu: FloatArray) -> CheckupFinding:
    bias, noise = np.linalg.norm(angular_velocity_in_imu.mean(axis=0)), angular_velocity_in_imu.std(axis=0).max()
    value = f"mean {bias * 1000:.1f} mrad/s, noise {noise * 1000:.1f} mrad/s"
    fine = bias < _BIAS and noise < _STILL
    return _judged("gyroscope at rest", value, fine, "the robot moves, or its gyroscope is biased")


def _gravity(acceleration_in_imu: FloatArray) -> CheckupFinding:
    size = float(np.linalg.norm(acceleration_in_imu))
    fine = WELL_SCALED_ACCELERATION_AT_REST[0] < size < WELL_SCALED_ACCELERATION_AT_REST[1]
    in_g = AT_REST_IN_UNITS_OF_G[0] < size < AT_REST_IN_UNITS_OF_G[1]
    hint = f"it must read about {GRAVITY} m/s2 upward at rest" + (" (is it in units of g?)" if in_g else "")
    return _judged("accelerometer at rest", f"{size:.2f} m/s2", fine, hint, serious=True)


def _floor(robot: RobotModel, position: FloatArray, acceleration_in_imu: FloatArray) -> CheckupFinding:
    """Check up from the accelerometer against the normal of the floor under the feet."""
    feet = foot_positions(robot, position)
    normal = floor_normals_by_fit(feet[None])[0][0]
    rotation = np.array(robot.imu_in_base.rotation)
    up = rotation @ acceleration_in_imu / max(float(np.linalg.norm(acceleration_in_imu)), 1e-9)
    angle = float(np.arccos(np.clip(up @ normal, -1, 1)))
    value = (
        f"{np.degrees(angle):.1f} deg between up and the feet's floor; up is ({up[0]:+.2f}, {up[1]:+.2f}, {up[2]:+.2f})"
    )
    turned = f"is the IMU rotated ({upright_flag(rotation, acceleration_in_imu, normal)})"
    if lies(robot, nominal_stance(robot), position):
        fine = None if bool(angle < _LYING_LEAN) else False
        advice = "does the robot lie level?" if fine is None else f"{turned}, does the robot lie level?"
        return CheckupFinding("gravity against the stance", value + " (the robot lies)", fine, advice, serious=True)
    advice = f"{turned}, is the joint map right, does the floor slope?"
    return _judged("gravity against the stance", value, angle < _LEAN, advice, serious=True)


def _torque(robot: RobotModel, position: FloatArray, torque: FloatArray | None) -> CheckupFinding:
    if torque is None:
        return CheckupFinding("joint torques", "not reported", None, "the mass then needs a scale: --mass")
    mass = carried_mass(robot, position, torque.mean(axis=0))
    value = f"they carry {mass:.1f} kg; the model weighs {robot.mass:.1f} kg"
    if lies(robot, nominal_stance(robot), position):
        return CheckupFinding("joint torques", value + " (the robot lies)", None)
    fine = _MASS_RANGE[0] < mass / robot.mass < _MASS_RANGE[1]
    return _judged("joint torques", value, fine, "are they in Nm, with the joints' signs?", serious=True)


def _health(robot: RobotModel, health: Health) -> list[CheckupFinding]:
    found: list[CheckupFinding] = []
    temperature, voltage, charge = health.motor_temperature, health.battery_voltage, health.battery_charge
    if temperature is not None:
        hottest = int(np.argmax(temperature))
        value = f"{temperature[hottest]:.0f} deg C at most ({robot.joint_names[hottest]})"
        found.append(_judged("motor temperatures", value, temperature[hottest] < _HOT, "let them cool down first"))
    if voltage is not None:
        found.append(CheckupFinding("battery voltage", f"{voltage:.1f} V", None))
    if charge is not None:
        found.append(_judged("battery charge", f"{charge:.0%}", charge > _WEAK_BATTERY, "charge it first"))
    if health.fault is not None:
        found.append(CheckupFinding("fault", health.fault, False, "see the robot's manual", serious=True))
    return found
