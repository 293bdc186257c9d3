"""Information of leg swings on the links' inertial parameters and the gains, for an estimate of both.

The swing's equation is almost linear in them near the motor fit, so that a linear system contains its information. The
motors' other parameters are eliminated, which leaves fewer rows (square-root information filter; Bierman 1977, chapter II).

Model errors are nuisance parameters too, because otherwise imperfect gears would bias the legs:

- load-dependent friction of each joint;
- inertias of the links that are not proportional to their masses;
- other errors that depend on speed or load (`MotorFit.model_error`), in a gain and in the torque of a link's first moment on
  its own joint.
"""

from __future__ import annotations

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.estimator.equations.torque_balance import columns_of_links
from equipoise.estimator.motors.equations import MotorSamples
from equipoise.estimator.motors.fit import MotorFit, positive_size, prior_stds, size
from equipoise.robot.model import RobotModel
from equipoise.robot.scale import Scale

_LOAD = 0.05  # friction over the torque that a gear carries
_OWN_INERTIA = 0.1  # of a link's inertia about its CoM, not proportional to its mass
_MISALIGNMENT = 0.01  # [rad] of gravity relative to the legs, by joint offsets and the IMU's mounting
_TENSOR = ([0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2])  # Pinocchio's order

_Nuisance = tuple[FloatArray, float, float]
"""Column (n, nj) of a nuisance parameter, and the standard deviation and mean of its prior."""


def legs_in_swing(
    robot: RobotModel, samples: MotorSamples, fit: MotorFit, scale: Scale
) -> tuple[FloatArray, FloatArray]:
    """Build the whitened linear system of the swings in the links' inertial parameters and the gains.

    Returns:
        (r, 4 links + nj) columns of the links' inertial parameters, as in `momenta`, and of each joint's gain, the ratio of
        true to reported torque minus one; (r,) right-hand side.

    Raises:
        RecordingError: torques are not reported, and gains are undefined.
    """
    if not samples.reported:
        raise RecordingError("joint torques are not reported: swings do not determine the masses of links")
    per_gain, prior = 1 / fit.gain, prior_stds(samples, scale)
    links = per_gain[:, None] * columns_of_links(robot, samples.regressor)
    own = per_gain[:, None] * _own_inertias(robot, samples)
    by_gain = -(per_gain**2) * fit.carried
    gains = np.stack([_alone(by_gain, joint) for joint in range(by_gain.shape[1])], axis=-1)

    joints = [int(joint) for leg in robot.legs.values() for joint in leg.joints]  # the one that moves each leg link
    nuisances: list[_Nuisance] = []
    for name, term in samples.terms(fit.stribeck_speed).items():
        nuisances += _of_each_joint(per_gain * term, prior[name])
    nuisances += _of_each_joint(np.ones_like(samples.torque), prior["offset"])
    nuisances += _of_each_joint(samples.sign * np.abs(samples.torque), _LOAD)
    nuisances.append((per_gain * samples.spin, prior["spin"], 0.0))
    nuisances.append((samples.kp * samples.command_rate, prior["lag"], samples.period / 2))
    for joint, column in zip(joints, np.moveaxis(own, -1, 0), strict=True):
        if (rms := size(column, samples.slides)[joint]) > 0:
            nuisances.append((column, float(np.hypot(_OWN_INERTIA, fit.model_error[joint] / rms)), 0.0))
    moment_error = np.hypot(fit.model_error, _MISALIGNMENT * size(fit.carried, samples.slides))
    nuisances += _of_each_joint(by_gain, fit.model_error / positive_size(samples.torque, samples.slides))
    for joint, column in zip(np.repeat(joints, 3), np.moveaxis(links[..., len(joints) :], -1, 0), strict=True):
        if (rms := size(column, samples.slides)[joint]) > 0:
            nuisances.append((_alone(column, joint), float(moment_error[joint] / rms), 0.0))
    target = samples.torque + by_gain * (fit.gain - 1)
    system = _eliminated(nuisances, np.concatenate([links, gains, target[..., None]], axis=-1), samples, fit)
    return system[:, :-1], system[:, -1]


def _eliminated(nuisances: list[_Nuisance], system: FloatArray, samples: MotorSamples, fit: MotorFit) -> FloatArray:
    """Eliminate nuisance parameters from an (n, nj, k) system; returns (r, k) rows with the same information."""
    used = [nuisance for nuisance in nuisances if nuisance[1] > 0]
    std, mean = np.array([nuisance[1:] for nuisance in used]).T
    whole, count = np.concatenate([np.stack([column for column, _, _ in used], axis=-1), system], axis=-1), len(used)
    weight = samples.slides / fit.noise / np.sqrt(fit.repetition)
    prior = np.zeros((count, whole.shape[-1]))
    prior[:, :count], prior[:, -1] = np.diag(1 / std), mean / std
    rows = np.concatenate([prior, (whole * weight[..., None]).reshape(-1, whole.shape[-1])])
    triangle = np.asarray(np.linalg.qr(rows, mode="r"), dtype=float)
    return triangle[count:-1, count:]  # the last row is the norm of the residual


def _own_inertias(robot: RobotModel, samples: MotorSamples) -> FloatArray:
    """Return (n, nj, links) torques of the links' inertias about their CoMs."""
    joints = [joint for leg in robot.legs.values() for joint in leg.joint_ids]
    parts = [samples.regressor[:, :, 10 * (joint - 1) + 4 : 10 * joint] for joint in joints]
    bodies = [robot.pinocchio.inertias[joint] for joint in joints]
    return np.stack([part @ body.inertia[_TENSOR] for part, body in zip(parts, bodies, strict=True)], axis=-1)


def _of_each_joint(columns: FloatArray, std: FloatArray | float) -> list[_Nuisance]:
    """Return one parameter of each joint, with the joint's column of (n, nj) torques and its prior."""
    each = enumerate(np.broadcast_to(std, columns.shape[1]).tolist())
    return [(_alone(columns, joint), own, 0.0) for joint, own in each]


def _alone(columns: FloatArray, joint: int) -> FloatArray:
    """Return (n, nj) torques of one joint, with zeros for the others."""
    alone = np.zeros_like(columns)
    alone[:, joint] = columns[:, joint]
    return alone
