"""Simulated swing recording of the nominal robot, for the predictions of a plan.

Legs are rigid and hang from a resting base. Motors obey their control law without steps, with half the prior standard
deviation as friction and rotor inertia. Only the standard deviations of an estimate from this recording are used.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from equipoise.bayesian.predict import ACCELEROMETER_NOISE, ENCODER_NOISE, GYRO_NOISE, RATE, VELOCITY_NOISE
from equipoise.conventions import GRAVITY, FloatArray
from equipoise.estimator.motors.delay import NOMINAL_DELAY
from equipoise.estimator.unknowns import Priors
from equipoise.experiments.legs_up import legs_up
from equipoise.experiments.swing import RAMP_TIME, SOFTER, swing_angles
from equipoise.recording.event import PHASE, TRIAL, Event
from equipoise.recording.phases import Phase
from equipoise.recording.recording import CommandStream, ImuStream, JointStream, Recording
from equipoise.recording.trials import MotorTrial
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

_TORQUE_NOISE = 0.2  # of current sensors [Nm] on an A1
_TURNING = 0.01  # [rad/s]: sgn(v) = tanh(v / v_0)


def nominal_swing(robot: RobotModel, stance: Stance, duration: float) -> Recording:
    """Simulate the recording of `swing_legs` at 500 Hz.

    Args:
        duration: time of the steady part [s].

    Raises:
        ReachError: the robot cannot turn its legs up.
    """
    up, ramp = legs_up(robot, stance), RAMP_TIME * stance.scale.time
    time: FloatArray = np.arange(1.0, round((duration + 2 * ramp) * RATE) + 1) / RATE
    command = up.joint_position + swing_angles(robot, stance, up.swing, time)
    kp, kd = robot.gains(stance.hip_height)
    trial = MotorTrial(kp=SOFTER * kp, kd=SOFTER * kd)
    position, velocity, torque = _follow(robot, stance, trial, command)
    noise = np.random.default_rng(0).normal
    joints = JointStream(
        time,
        position + noise(0.0, ENCODER_NOISE, position.shape),
        velocity + noise(0.0, VELOCITY_NOISE, position.shape),
        torque + noise(0.0, _TORQUE_NOISE * stance.scale.torque, position.shape),
    )
    at_rest = (len(time), 3)
    up_in_imu = np.array(robot.imu_in_base.rotation)[2]  # the lying base is level
    force = GRAVITY * up_in_imu + noise(0.0, ACCELEROMETER_NOISE, at_rest)
    phases = ((Phase.RAMP, 0.0), (Phase.SWING, ramp), (Phase.END, ramp + duration))
    return Recording(
        robot.joint_names,
        joints,
        ImuStream(time, noise(0.0, GYRO_NOISE, at_rest), force),
        CommandStream(time, command),
        (Event(0.0, TRIAL, trial.to_data()), *(Event(when, PHASE, {"name": name}) for name, when in phases)),
    )


def _follow(
    robot: RobotModel, stance: Stance, trial: MotorTrial, command: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Simulate joints that follow (n, nj) targets [rad]: positions [rad], velocities [rad/s] and motor torques [Nm]."""
    assert trial.kp is not None
    assert trial.kd is not None
    model, priors, strong = robot.pinocchio, Priors(), stance.scale.torque / 2
    data, step, still, at_rest = model.createData(), 1 / RATE, np.zeros(6), np.zeros(model.nv)
    late = round(NOMINAL_DELAY * RATE)
    q: FloatArray = command[0]
    v: FloatArray = np.zeros_like(q)
    states: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    for target in np.concatenate([np.repeat(command[:1], late, axis=0), command])[: len(command)]:
        torque = trial.kp * (target - q) - trial.kd * v
        states.append((q, v, torque))
        configuration = robot.configuration(q)
        upper = np.triu(np.asarray(pin.crba(model, data, configuration), dtype=float)[6:, 6:])
        inertia: FloatArray = upper + np.triu(upper, 1).T + priors.armature * strong * np.eye(len(q))
        sign = np.tanh(v / _TURNING)
        drag = strong * (priors.coulomb_friction * sign + priors.viscous_friction * v)
        # Implicit damping, at the end of the step, keeps light legs behind stiff motors stable.
        damping = trial.kd + strong * (priors.coulomb_friction * (1 - sign**2) / _TURNING + priors.viscous_friction)
        bias = np.asarray(pin.rnea(model, data, configuration, np.concatenate([still, v]), at_rest), dtype=float)[6:]
        v = v + step * np.asarray(np.linalg.solve(inertia + np.diag(step * damping), torque - drag - bias), dtype=float)
        q = q + step * v
    position, velocity, torques = (np.array(column) for column in zip(*states, strict=True))
    return position, velocity, torques
