"""The law of a motor, and the delay of the position loop: how old the command is that a reported torque obeys.

A motor's board makes tau = kp (q_cmd(t - d) - q) - kd v. Friction, gains and the legs are not in it: the d at which it fits
best is the delay. The velocity that a board damps may be younger or older than the one that it reports; how much is found
beside it.
"""

from __future__ import annotations

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.precise.measurements.smoothing import fit_spline
from equipoise.recording.phases import Phase
from equipoise.recording.recording import JointStream, Recording
from equipoise.recording.trials import MotorTrial

THOUGHT_DELAY = 4e-3  # d, where nothing tells it [s]
_KNOT = 0.02  # of the velocities' spline, for accelerations [s] on an A1
_ROUNDS = 4
_EACH = 0.1e-3  # [s] by which a board may differ from the mean of all


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


def position_loop_delays(recording: Recording, time_scale: float) -> tuple[FloatArray, FloatArray] | None:
    """(nj,) delays and their standard deviations [s]; None where torques, velocities or gains are not known.

    Args:
        time_scale: factor on times, of the robot's scale; one on an A1.
    """
    trial, joints = motor_trial(recording), recording.phase(Phase.SWING).joints
    if trial.kp is None or trial.kd is None or joints.torque is None or joints.velocity is None:
        return None
    delay = np.full(joints.position.shape[1], THOUGHT_DELAY)
    feedback = -trial.kp * joints.position - trial.kd * joints.velocity
    acceleration = fit_spline(joints.time, joints.velocity, _KNOT * time_scale).spline.derivative()(joints.time)
    deviation = np.zeros_like(delay)
    for joint, torque in enumerate(joints.torque.T):
        for _ in range(_ROUNDS):
            target, rate = command_at(recording, joints.time - delay[joint])
            left = torque - trial.kp * target[:, joint] - feedback[:, joint]
            design = np.column_stack(
                [-trial.kp * rate[:, joint], np.ones_like(torque), trial.kd * acceleration[:, joint]]
            )
            inverse = np.linalg.inv(design.T @ design)
            found = inverse @ design.T @ left
            delay[joint] += found[0]
            deviation[joint] = np.sqrt(inverse[0, 0]) * np.std(left - design @ found)
    return _alike(delay, deviation)


def _alike(delay: FloatArray, deviation: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Delays and deviations of boards of one kind, on one bus, that may differ by a little each."""
    own, weight = _EACH**2, 1 / (deviation**2 + _EACH**2)
    mean = float((weight * delay).sum() / weight.sum())
    left = deviation**2 / (deviation**2 + own)  # share of a board's own reading that is noise
    return mean + (1 - left) * (delay - mean), np.sqrt((1 - left) * deviation**2 + left**2 / weight.sum())
