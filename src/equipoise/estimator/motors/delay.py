"""Control law of a motor and delay of its position loop: the age of the command in a reported torque.

A motor's board computes tau = kp (q_cmd(t - d) - q) - kd v, without friction, gains or legs. The delay is the d that fits
best. The velocity in the law may be earlier or later than the reported one; this time difference is estimated too.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.estimator.measurements.lift_samples import at_times
from equipoise.estimator.measurements.smoothing import fit_spline
from equipoise.recording.phases import Phase
from equipoise.recording.recording import JointStream, Recording
from equipoise.recording.trials import MotorTrial
from equipoise.robot.model import RobotModel

NOMINAL_DELAY = 4e-3  # d, if it is not identified [s]
_KNOT = 0.02  # of the velocities' spline, for accelerations [s] on an A1
_ROUNDS = 4
_EACH = 0.1e-3  # [s] by which a board may differ from the mean of all
_LATER = (-0.01, 0.0, 0.01, 0.02, 0.04, 0.06, 0.08, 0.12)  # [s] on an A1: commands that a joint's motion follows
_SIGNIFICANT = 4.0  # standard deviations


def motor_trial(recording: Recording) -> MotorTrial:
    """Return the motor trial of a recording; raises RecordingError for other recordings."""
    trial = recording.trial
    if not isinstance(trial, MotorTrial) or not recording.complete or recording.commands is None:
        raise RecordingError("the recording is not a complete swing of all joints")
    return trial


def command_at(recording: Recording, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return (n, nj) position targets [rad] and their rates [rad/s] at (n,) times, linear between commands."""
    assert recording.commands is not None
    sent, targets = recording.commands.time, recording.commands.position
    rates = np.gradient(targets, sent, axis=0)
    return at_times(time, sent, targets), at_times(time, sent, rates)


def law_torque(
    recording: Recording, joints: JointStream, velocity: FloatArray, delay: FloatArray | float
) -> FloatArray:
    """Compute (n, nj) torques of the motors' control law at joint samples of a recording with known gains [Nm].

    Args:
        joints: joint samples.
        velocity: (n, nj) joint velocities in the damping term [rad/s].
        delay: delay of the position loop, or (nj,) delays [s].
    """
    trial = motor_trial(recording)
    assert trial.kp is not None
    assert trial.kd is not None
    ages = np.broadcast_to(delay, joints.position.shape[1:])
    target = np.column_stack([command_at(recording, joints.time - age)[0][:, j] for j, age in enumerate(ages)])
    return np.asarray(trial.kp * (target - joints.position) - trial.kd * velocity, dtype=float)


def swinging_joints(robot: RobotModel, trial: MotorTrial) -> tuple[int, ...]:
    """Return the indices of the joints that swing in a trial."""
    return tuple(range(len(robot.joint_names))) if trial.leg is None else robot.legs[trial.leg].joints


def position_loop_delays(
    robot: RobotModel, swings: Sequence[Recording], time_scale: float
) -> tuple[FloatArray, FloatArray] | None:
    """Estimate (nj,) delays and their standard deviations [s]; None without torques, velocities or gains.

    Args:
        swings: recordings that together contain a swing of every joint.
        time_scale: time scale of the robot, relative to an A1.
    """
    each = [list(swinging_joints(robot, motor_trial(recording))) for recording in swings]
    if not all(_has_delay_data(recording) for recording in swings):
        return None
    scale, delays = _torque_scale(swings, each, time_scale), np.zeros((2, len(robot.joint_names)))
    for recording, joints in zip(swings, each, strict=True):
        delays[:, joints] = _fitted(recording, joints, time_scale, scale)[:, :2].T
    return _pooled(*delays)


def _has_delay_data(recording: Recording) -> bool:
    trial, joints = motor_trial(recording), recording.joints
    return None not in (trial.kp, trial.kd) and joints.torque is not None and joints.velocity is not None


def _torque_scale(swings: Sequence[Recording], each: Sequence[Sequence[int]], time_scale: float) -> float:
    """Return the ratio of reported torque to the law's if it differs significantly from one, else one.

    Motors that report their commanded torque report it exactly. A measured torque, or one with another torque constant, would
    otherwise bias the delay: 3 % correspond to 0.4 ms.

    Args:
        each: indices of the swinging joints of each recording.
    """
    parts = [_fitted(recording, joints, time_scale, None) for recording, joints in zip(swings, each, strict=True)]
    excess, std = np.concatenate(parts)[:, 2:].T
    weight = std**-2
    mean = float((weight * excess).sum() / weight.sum())
    return 1.0 + mean if mean**2 * weight.sum() > _SIGNIFICANT**2 else 1.0


def _fitted(recording: Recording, of: Sequence[int], time_scale: float, scale: float | None) -> FloatArray:
    """Fit each of k joints separately; returns (k, 4) delay and std [s], relative excess of torque over the law and std.

    Args:
        scale: ratio of reported torque to the law's; None: it is estimated.
    """
    trial, joints = motor_trial(recording), recording.phase(Phase.SWING).joints
    assert trial.kp is not None
    assert trial.kd is not None
    assert joints.torque is not None
    assert joints.velocity is not None
    feedback = -trial.kp * joints.position - trial.kd * joints.velocity
    acceleration = fit_spline(joints.time, joints.velocity, _KNOT * time_scale).spline.derivative()(joints.time)
    sent = [command_at(recording, joints.time - NOMINAL_DELAY - later * time_scale)[0] for later in _LATER]
    rows = np.zeros((len(of), 4))
    for row, joint in zip(rows, of, strict=True):
        torque, row[0] = joints.torque[:, joint] / (scale or 1.0), NOMINAL_DELAY
        for _ in range(_ROUNDS):
            target, rate = command_at(recording, joints.time - row[0])
            law = trial.kp * target[:, joint] + feedback[:, joint]
            terms = [-trial.kp * rate[:, joint], np.ones_like(law), trial.kd * acceleration[:, joint]]
            design, left = np.column_stack(terms if scale else [*terms, law]), torque - law
            # Noise in the law's readings would bias its coefficient towards zero. Its regression on the noise-free commands
            # replaces it (instrumental variables, two-stage least squares).
            commands = np.column_stack([np.ones_like(law), *(targets[:, joint] for targets in sent)])
            instrument = design if scale else commands @ np.linalg.lstsq(commands, design, rcond=None)[0]
            inverse = np.linalg.inv(instrument.T @ design)
            fit = inverse @ instrument.T @ left
            std = np.sqrt(np.diag(inverse @ instrument.T @ instrument @ inverse.T)) * np.std(left - design @ fit)
            row[:] = row[0] + fit[0], std[0], fit[-1], std[-1]
    return rows


def _pooled(delay: FloatArray, std: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shrink delays towards their mean and return them with their std: boards of one kind on one bus differ little."""
    own, weight = _EACH**2, 1 / (std**2 + _EACH**2)
    mean = float((weight * delay).sum() / weight.sum())
    left = std**2 / (std**2 + own)  # share of noise in a board's own delay
    return mean + (1 - left) * (delay - mean), np.sqrt((1 - left) * std**2 + left**2 / weight.sum())
