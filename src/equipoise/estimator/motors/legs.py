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
from equipoise.estimator.motors.fit import MotorFit, positive_size, size
from equipoise.robot.model import RobotModel

_LOAD = 0.05  # friction over the torque that a gear carries
_OWN_INERTIA = 0.1  # of a link's inertia about its CoM, not proportional to its mass
_MISALIGNMENT = 0.01  # [rad] of gravity relative to the legs, by joint offsets and the IMU's mounting
_TENSOR = ([0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2])  # Pinocchio's order

_Nuisance = tuple[FloatArray, float, float]
"""Column (n, nj) of a nuisance parameter, and the standard deviation and mean of its prior."""


def legs_in_swing(fit: MotorFit) -> tuple[FloatArray, FloatArray]:
    """Build the whitened linear system of the swings in the links' inertial parameters and the gains.

    Returns:
        (r, 4 links + nj) columns of the links' inertial parameters, as in `momenta`, and of each joint's gain, the ratio of
        true to reported torque minus one; (r,) right-hand side.

    Raises:
        RecordingError: torques are not reported, and gains are undefined.
    """
    problem, samples, robot = fit.problem, fit.problem.samples, fit.problem.robot
    if not samples.reported:
        raise RecordingError("joint torques are not reported: swings do not determine the masses of links")
    _, design = problem.linearised(problem.x)
    gain, gains = 1 + problem.x[problem.of("gain")], design[:, :, problem.of("gain")]
    links = columns_of_links(robot, samples.regressor) / gain[:, None]
    own = _own_inertias(robot, samples) / gain[:, None]
    by_gain = gains.sum(axis=-1)
    carried = -(gain**2) * by_gain  # true torques of legs, friction and rotors

    joints = [int(joint) for leg in robot.legs.values() for joint in leg.joints]  # the one that moves each leg link
    others = slice(problem.of("gain").stop, None)  # friction, armature, offsets, spin and lag
    nuisances: list[_Nuisance] = [
        *zip(np.moveaxis(design[:, :, others], -1, 0), problem.prior[others], problem.start[others], strict=True)
    ]
    nuisances += _of_each_joint(samples.sign * np.abs(samples.torque), _LOAD)
    for joint, column in zip(joints, np.moveaxis(own, -1, 0), strict=True):
        if (rms := size(column, samples.slides)[joint]) > 0:
            nuisances.append((column, float(np.hypot(_OWN_INERTIA, fit.model_error[joint] / rms)), 0.0))
    moment_error = np.hypot(fit.model_error, _MISALIGNMENT * size(carried, samples.slides))
    nuisances += _of_each_joint(by_gain, fit.model_error / positive_size(samples.torque, samples.slides))
    for joint, column in zip(np.repeat(joints, 3), np.moveaxis(links[..., len(joints) :], -1, 0), strict=True):
        if (rms := size(column, samples.slides)[joint]) > 0:
            nuisances.append((_alone(column, joint), float(moment_error[joint] / rms), 0.0))
    target = samples.torque + by_gain * (gain - 1)
    system = _eliminated(nuisances, np.concatenate([links, gains, target[..., None]], axis=-1), fit)
    return system[:, :-1], system[:, -1]


def _eliminated(nuisances: list[_Nuisance], system: FloatArray, fit: MotorFit) -> FloatArray:
    """Eliminate nuisance parameters from an (n, nj, k) system; returns (r, k) rows with the same information."""
    used = [nuisance for nuisance in nuisances if nuisance[1] > 0]
    std, mean = np.array([nuisance[1:] for nuisance in used]).T
    whole, count = np.concatenate([np.stack([column for column, _, _ in used], axis=-1), system], axis=-1), len(used)
    weight = fit.problem.samples.slides / fit.problem.noise / np.sqrt(fit.repetition)
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
