"""What the swing says of the legs' links, for an estimate that looks for them too.

The motors' fit and that estimate share two kinds of unknowns: the links' inertial parameters and the gains. In both the
swing's equation is all but linear near the fit, so that a linear system holds all that it says of them: the motors' other
unknowns are solved for on the way, which leaves fewer rows (a square-root information filter's; Bierman 1977, chapter II).

What the equation does not have is among these too, or a robot whose gears rattle and rub would get wrong legs:

- friction that follows load, of each joint;
- inertias of the links that do not follow from their masses;
- whatever repeats with speed or load and is not seen (`MotorFit.unseen`): so much may be in a gain, and in what a joint feels
  of its own link's first moment.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.estimator.equations.torque_balance import columns_of_links
from equipoise.estimator.motors.equations import MotorSamples
from equipoise.estimator.motors.fit import MotorFit, positive_size, prior_stds, size
from equipoise.robot.model import RobotModel
from equipoise.robot.scale import Scale

_LOAD = 0.05  # friction over the torque that a gear carries
_OWN_INERTIA = 0.1  # of a link's about its CoM, beside what goes with its mass
_ASKEW = 0.01  # of what a joint carries [rad]: by how much zeros and the IMU's mounting turn gravity against the legs
_TENSOR = ([0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2])  # Pinocchio's order


@dataclass
class _Nuisances:
    """Columns of unknowns that are solved for on the way, and what is believed of them."""

    columns: list[FloatArray] = field(default_factory=list[FloatArray])
    mean: list[float] = field(default_factory=list[float])
    std: list[float] = field(default_factory=list[float])

    def add(self, column: FloatArray, std: float, mean: float = 0.0) -> None:
        """One unknown's (n, nj) column; none that is known."""
        if std > 0:
            self.columns.append(column)
            self.mean.append(mean)
            self.std.append(std)

    def add_each(self, columns: FloatArray, std: FloatArray | float) -> None:
        """One unknown of each joint, (n, nj) columns of the torque of that joint alone."""
        for joint, sd in enumerate(np.broadcast_to(std, columns.shape[1]).tolist()):
            self.add(_alone(columns, joint), sd)


def legs_in_swing(
    robot: RobotModel, samples: MotorSamples, fit: MotorFit, scale: Scale
) -> tuple[FloatArray, FloatArray]:
    """A linear system in the links' inertial parameters and the gains that says the same of them as the swings; whitened.

    Returns:
        (r, 4 links + nj) columns of the links' inertial parameters, as of `momenta`, and of the gain of each joint, true over
        reported torque, less one; (r,) what they add up to.

    Raises:
        RecordingError: torques are not reported, whose gains would be others.
    """
    if not samples.reported:
        raise RecordingError("joint torques are not reported, so that swings determine no masses of links")
    per_gain, prior = 1 / fit.gain, prior_stds(samples, scale)
    links = per_gain[:, None] * columns_of_links(robot, samples.regressor)
    own = per_gain[:, None] * _own_inertias(robot, samples)
    by_gain = -(per_gain**2) * fit.carried
    gains = np.stack([_alone(by_gain, joint) for joint in range(by_gain.shape[1])], axis=-1)

    beside = _Nuisances()
    shapes = {name: per_gain * term for name, term in samples.terms(fit.stribeck_speed).items()}
    shapes["offset"] = np.ones_like(samples.torque)
    for name, shape in shapes.items():
        beside.add_each(shape, prior[name])
    beside.add_each(samples.sign * np.abs(samples.torque), _LOAD)
    beside.add(per_gain * samples.spin, prior["spin"])
    beside.add(samples.kp * samples.command_rate, prior["lag"], samples.period / 2)
    for joint, column in zip(_joints(robot), np.moveaxis(own, -1, 0), strict=True):
        felt = size(column, samples.slides)[joint]
        beside.add(column, float(np.hypot(_OWN_INERTIA, fit.unseen[joint] / felt)) if felt > 0 else 0.0)
    askew = np.hypot(fit.unseen, _ASKEW * size(fit.carried, samples.slides))
    beside.add_each(by_gain, fit.unseen / positive_size(samples.torque, samples.slides))
    moments = np.moveaxis(links[..., own.shape[-1] :], -1, 0).reshape(own.shape[-1], 3, *samples.torque.shape)
    for joint, of_link in zip(_joints(robot), moments, strict=True):
        for column in of_link:
            felt = size(column, samples.slides)[joint]
            beside.add(_alone(column, joint), float(askew[joint] / felt) if felt > 0 else 0.0)

    target = samples.torque + by_gain * (fit.gain - 1)
    found = _solved_for(beside, np.concatenate([links, gains, target[..., None]], axis=-1), samples, fit)
    return found[:, :-1], found[:, -1]


def _solved_for(beside: _Nuisances, system: FloatArray, samples: MotorSamples, fit: MotorFit) -> FloatArray:
    """(r, k) rows of an (n, nj, k) system that say the same of its unknowns as all rows, the nuisances solved for."""
    whole = np.concatenate([np.stack(beside.columns, axis=-1), system], axis=-1)
    weight = samples.slides / fit.noise / np.sqrt(fit.repetition)
    count = len(beside.mean)
    believed = np.zeros((count, whole.shape[-1]))
    believed[:, :count] = np.diag(1 / np.array(beside.std))
    believed[:, -1] = np.array(beside.mean) / beside.std
    rows = np.concatenate([believed, (whole * weight[..., None]).reshape(-1, whole.shape[-1])])
    triangle = np.asarray(np.linalg.qr(rows, mode="r"), dtype=float)
    return triangle[count:-1, count:]  # the last row is what no unknown explains


def _own_inertias(robot: RobotModel, samples: MotorSamples) -> FloatArray:
    """(n, nj, links) torques by factors on the links' inertias about their CoMs."""
    joints = [joint for leg in robot.legs.values() for joint in leg.joint_ids]
    parts = [samples.regressor[:, :, 10 * (joint - 1) + 4 : 10 * joint] for joint in joints]
    bodies = [robot.pinocchio.inertias[joint] for joint in joints]
    return np.stack([part @ body.inertia[_TENSOR] for part, body in zip(parts, bodies, strict=True)], axis=-1)


def _joints(robot: RobotModel) -> list[int]:
    """Of each leg link, the index of the joint that moves it."""
    return [int(joint) for leg in robot.legs.values() for joint in leg.joints]


def _alone(columns: FloatArray, joint: int) -> FloatArray:
    """(n, nj) the torques of one joint, others zero."""
    alone = np.zeros_like(columns)
    alone[:, joint] = columns[:, joint]
    return alone
