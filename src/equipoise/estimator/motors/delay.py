"""The law of a motor, and the delay of the position loop: how old the command is that a reported torque obeys.

A motor's board makes tau = kp (q_cmd(t - d) - q) - kd v. Friction, gains and the legs are not in it: the d at which it fits
best is the delay. The velocity that a board damps may be younger or older than the one that it reports; how much is found
beside it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.estimator.measurements.smoothing import fit_spline
from equipoise.recording.phases import Phase
from equipoise.recording.recording import JointStream, Recording
from equipoise.recording.trials import MotorTrial
from equipoise.robot.model import RobotModel

THOUGHT_DELAY = 4e-3  # d, where nothing tells it [s]
_KNOT = 0.02  # of the velocities' spline, for accelerations [s] on an A1
_ROUNDS = 4
_EACH = 0.1e-3  # [s] by which a board may differ from the mean of all
_LATER = (-0.01, 0.0, 0.01, 0.02, 0.04, 0.06, 0.08, 0.12)  # [s] on an A1: commands that a joint's motion follows
_SURELY = 4.0  # standard deviations


def motor_trial(recording: Recording) -> MotorTrial:
    """The trial that a recording is of; raises RecordingError if it is of another kind."""
    trial = recording.trial
    if not isinstance(trial, MotorTrial) or not recording.complete or recording.commands is None:
        raise RecordingError("the recording holds no complete swing of all joints")
    return trial


def command_at(recording: Recording, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n, nj) position targets [rad] and their rates [rad/s] at (n,) times, linear between commands."""
    assert recording.commands is not None
    sent, targets = recording.commands.time, recording.commands.position
    rates = np.gradient(targets, sent, axis=0)
    columns = [np.column_stack([np.interp(time, sent, column) for column in part.T]) for part in (targets, rates)]
    return columns[0], columns[1]


def law_torque(
    recording: Recording, joints: JointStream, velocity: FloatArray, delay: FloatArray | float
) -> FloatArray:
    """(n, nj) torques of the motors' own law at joint samples of a recording with known gains [Nm].

    Args:
        joints: the samples.
        velocity: (n, nj) joint velocities that are damped [rad/s].
        delay: age of the command that a motor obeys, or (nj,) ages [s].
    """
    trial = motor_trial(recording)
    assert trial.kp is not None
    assert trial.kd is not None
    ages = np.broadcast_to(delay, joints.position.shape[1:])
    target = np.column_stack([command_at(recording, joints.time - age)[0][:, j] for j, age in enumerate(ages)])
    return np.asarray(trial.kp * (target - joints.position) - trial.kd * velocity, dtype=float)


def joints_that_swing(robot: RobotModel, trial: MotorTrial) -> tuple[int, ...]:
    """Indices of the joints that a trial is about."""
    return tuple(range(len(robot.joint_names))) if trial.leg is None else robot.legs[trial.leg].joints


def position_loop_delays(
    robot: RobotModel, swings: Sequence[Recording], time_scale: float
) -> tuple[FloatArray, FloatArray] | None:
    """(nj,) delays and their standard deviations [s]; None where torques, velocities or gains are not known.

    Args:
        swings: recordings in which all joints swing between them.
        time_scale: factor on times, of the robot's scale; one on an A1.
    """
    each = [list(joints_that_swing(robot, motor_trial(recording))) for recording in swings]
    if not all(_is_told(recording) for recording in swings):
        return None
    scale, found = _torque_scale(swings, each, time_scale), np.zeros((2, len(robot.joint_names)))
    for recording, joints in zip(swings, each, strict=True):
        found[:, joints] = _fitted(recording, joints, time_scale, scale)[:, :2].T
    return _alike(*found)


def _is_told(recording: Recording) -> bool:
    trial, joints = motor_trial(recording), recording.joints
    return None not in (trial.kp, trial.kd) and joints.torque is not None and joints.velocity is not None


def _torque_scale(swings: Sequence[Recording], each: Sequence[Sequence[int]], time_scale: float) -> float:
    """Reported torque over the law's where that is surely not one, else one.

    Motors that report what they ask of themselves report it to the digit. A torque that a sensor of its own reads, or that is
    reported by another constant, would look like an older or a younger command: 3 % like 0.4 ms.

    Args:
        each: indices of the joints that swing in each.
    """
    parts = [_fitted(recording, joints, time_scale, None) for recording, joints in zip(swings, each, strict=True)]
    more, std = np.concatenate(parts)[:, 2:].T
    weight = std**-2
    mean = float((weight * more).sum() / weight.sum())
    return 1.0 + mean if mean**2 * weight.sum() > _SURELY**2 else 1.0


def _fitted(recording: Recording, of: Sequence[int], time_scale: float, scale: float | None) -> FloatArray:
    """(k, 4) delays of k joints and deviations [s], each by itself; by how much torque is more than the law's, and deviations.

    Args:
        scale: reported torque over the law's; None: it is found, too.
    """
    trial, joints = motor_trial(recording), recording.phase(Phase.SWING).joints
    assert trial.kp is not None
    assert trial.kd is not None
    assert joints.torque is not None
    assert joints.velocity is not None
    feedback = -trial.kp * joints.position - trial.kd * joints.velocity
    acceleration = fit_spline(joints.time, joints.velocity, _KNOT * time_scale).spline.derivative()(joints.time)
    sent = [command_at(recording, joints.time - THOUGHT_DELAY - later * time_scale)[0] for later in _LATER]
    rows = np.zeros((len(of), 4))
    for row, joint in zip(rows, of, strict=True):
        torque, row[0] = joints.torque[:, joint] / (scale or 1.0), THOUGHT_DELAY
        for _ in range(_ROUNDS):
            target, rate = command_at(recording, joints.time - row[0])
            law = trial.kp * target[:, joint] + feedback[:, joint]
            terms = [-trial.kp * rate[:, joint], np.ones_like(law), trial.kd * acceleration[:, joint]]
            design, left = np.column_stack(terms if scale else [*terms, law]), torque - law
            # The law is of readings with noise, which would draw its share towards zero: what commands explain of it, which
            # have none, stands in for it (two-stage least squares).
            known = np.column_stack([np.ones_like(law), *(targets[:, joint] for targets in sent)])
            stand_in = design if scale else known @ np.linalg.lstsq(known, design, rcond=None)[0]
            inverse = np.linalg.inv(stand_in.T @ design)
            found = inverse @ stand_in.T @ left
            std = np.sqrt(np.diag(inverse @ stand_in.T @ stand_in @ inverse.T)) * np.std(left - design @ found)
            row[:] = row[0] + found[0], std[0], found[-1], std[-1]
    return rows


def _alike(delay: FloatArray, std: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Delays and deviations of boards of one kind, on one bus, that may differ by a little each."""
    own, weight = _EACH**2, 1 / (std**2 + _EACH**2)
    mean = float((weight * delay).sum() / weight.sum())
    left = std**2 / (std**2 + own)  # share of a board's own reading that is noise
    return mean + (1 - left) * (delay - mean), np.sqrt((1 - left) * std**2 + left**2 / weight.sum())
