"""The delay of the position loop: how old the command is that a reported torque obeys.

A motor's board makes tau = kp (q_cmd(t - d) - q) - kd v. Friction, gains and the legs are not in it: the d at which it fits
best is the delay. The velocity that a board damps may be younger or older than the one that it reports; how much is found
beside it.
"""

from __future__ import annotations

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.motors.equations import SPACING, THOUGHT_DELAY, averages, command_at, law_torque, motor_trial
from equipoise.precise.measurements.smoothing import fit_spline
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording

_ROUNDS = 4
_UNLIKE = 0.05  # of the averaged torque: what may be left of it, beside noise, for the law's to be taken
_EACH = 0.1e-3  # [s] by which a board may differ from the mean of all


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
    acceleration = fit_spline(joints.time, joints.velocity, SPACING * time_scale).spline.derivative()(joints.time)
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


def torques_by_law(recording: Recording, time_scale: float, delay: FloatArray) -> FloatArray:
    """Torques of the motors' own law in the unit of the reported ones, which have their noise besides.

    Args:
        delay: (nj,) ages of the commands that motors obey, as of `position_loop_delays` [s].

    Returns:
        (n, nj) torques at the samples of the swing [Nm]; not a number where a motor reports something else.
    """
    steady = recording.phase(Phase.SWING)
    joints, spacing = steady.joints, SPACING * time_scale
    assert joints.torque is not None
    law = law_torque(recording, steady, delay)
    law -= law.mean(axis=0)
    reported = joints.torque - joints.torque.mean(axis=0)
    law *= (law * reported).sum(axis=0) / np.maximum((law**2).sum(axis=0), np.finfo(float).tiny)
    at = np.arange(joints.time[0] + 3 * spacing, joints.time[-1] - 3 * spacing, spacing)
    average = averages(joints.time, at, spacing)
    left, whole = (np.mean((average @ part) ** 2, axis=0) for part in (reported - law, reported))
    share = 151 / 315 * float(np.median(np.diff(joints.time))) / spacing  # of a sample's variance in an average
    noise = share * np.var(np.diff(reported - law, axis=0), axis=0) / 2
    return np.where(left - noise < _UNLIKE**2 * whole, law + joints.torque.mean(axis=0), np.nan)


def _alike(delay: FloatArray, deviation: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Delays and deviations of boards of one kind, on one bus, that may differ by a little each."""
    own, weight = _EACH**2, 1 / (deviation**2 + _EACH**2)
    mean = float((weight * delay).sum() / weight.sum())
    left = deviation**2 / (deviation**2 + own)  # share of a board's own reading that is noise
    return mean + (1 - left) * (delay - mean), np.sqrt((1 - left) * deviation**2 + left**2 / weight.sum())
