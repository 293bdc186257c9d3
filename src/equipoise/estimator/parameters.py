"""Parameter vector of the Bayesian method, and the bodies that follow from it."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.linalg import block_diag

from equipoise.conventions import FloatArray
from equipoise.estimator.measurements.leg_motion import LEG_SHAPE, LegChains, LegShape
from equipoise.estimator.measurements.momenta import model_parameters
from equipoise.estimator.measurements.traced import Traced
from equipoise.estimator.unknowns import A1_TORQUE, Priors, Unknown, Values, inputs_of, model_values
from equipoise.robot.inertial import InertialParameters, base_parameters, moment_parameters
from equipoise.robot.kinematics import Kinematics
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

LINKS = ("leg_mass", "leg_mass_common", "link_com", "link_com_common")
INERTIAL = ("base", *LINKS)
"""Parameters that determine the inertial parameters."""


@dataclass(frozen=True, eq=False)
class PriorDistribution:
    """Normal prior of the parameter table from a prior run.

    Attributes:
        mean: (n,) means, in units of the table's priors.
        covariance: (n, n) covariance, in the same units.
    """

    mean: FloatArray
    covariance: FloatArray

    @cached_property
    def information(self) -> FloatArray:
        """(n, n) inverse of the covariance."""
        return np.asarray(np.linalg.inv(self.covariance), dtype=float)

    def with_added_variance(self, place: int, variance: float) -> PriorDistribution:
        """Return the distribution with an added variance of one parameter."""
        added = np.zeros_like(self.covariance)
        added[place, place] = variance
        return PriorDistribution(self.mean, self.covariance + added)

    def score(self, x: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the (n,) scores of an estimate at the prior mean, and their (n, n) covariance if the mean is right.

        With prior information W, posterior mode x and posterior covariance C, these are s = W (x - mean) and W - W C W. A
        single parameter that differs from its mean does so by s_j over the variance of s_j.

        Args:
            x: (n,) posterior mode.
            covariance: (n, n) posterior covariance.
        """
        information = self.information
        return information @ (x - self.mean), information - information @ covariance @ information

    @cached_property
    def whitening(self) -> FloatArray:
        """(n, n) matrix that whitens differences from the mean."""
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.covariance)), dtype=float)


class Unknowns:
    """Layout of the parameter vector: ten log-Cholesky parameters of the base, then all others in units of their priors.

    Blocks are addressed by name: "base", and the names of the table's rows (unknowns.py).

    Attributes:
        rows: rows of the parameter table that are not fixed; fixed rows are not in the vector.
        size: length of the vector.
        legs: leg chains of the robot.
        scale: (size,) one unit of each parameter, in the unit of its row; one for the base.
        tabled: slice of all parameters except the base's.
        torque_scale: m g h of the robot over that of an A1.
        model_links: (4 links,) inertial parameters of the leg links in the model, as in `momenta`.
        of_links: (4 links, estimated) derivative of these by the values of LINKS that are not fixed.
        composing: names of the parameters that bodies depend on: the inertial ones, and with wide priors for lengths or hip
            positions also the leg shape. Drawing tolerances have no visible effect.
        run_prior: prior from a prior run; None: priors are those of the table.
    """

    run_prior: PriorDistribution | None = None

    def __init__(self, robot: RobotModel, stance: Stance, priors: Priors) -> None:
        self.robot, self.stance, self.priors, self.rows = robot, stance, priors, priors.estimated
        self.torque_scale = A1_TORQUE.of(robot, stance)
        self._model_values = model_values(robot)
        self._slices = {"base": slice(0, 10), **dict.fromkeys(self._model_values, slice(0, 0))}
        self.scale: FloatArray = np.ones(10)
        for row in self.rows:
            own = np.full(len(self.labels(row)), getattr(priors, row.name) * row.measure.of(robot, stance))
            self._slices[row.name] = slice(len(self.scale), len(self.scale) + len(own))
            self.scale = np.concatenate([self.scale, own])
        self.size = len(self.scale)
        self.tabled = slice(10, self.size)
        self._links = self.columns(*LINKS)
        counts = [(self.estimates(name), len(self._model_values[name])) for name in LINKS]
        estimated_links = np.concatenate([np.full(count, estimated) for estimated, count in counts])
        self.legs = LegChains(robot)
        self.of_links, self.model_links = _by_values(self.legs)[:, estimated_links], model_parameters(robot)[10:]
        joined, self._above_knees = _joined_bodies(robot, stance)
        # A cache: derivatives of bodies evaluate the same leg shape many times.
        self._joined_last = np.zeros(len(self.columns(*LEG_SHAPE))), joined
        estimated_shape = any(row.name in LEG_SHAPE for row in priors.widened)
        self.composing = (*INERTIAL, *LEG_SHAPE) if estimated_shape else INERTIAL
        self.model_base = base_parameters(robot)
        self.model_base_vector = self.model_base.vector

    def __getitem__(self, name: str) -> slice:
        return self._slices[name]

    def has(self, name: str) -> bool:
        """Return True if the table has a row of this name."""
        return name in self._slices

    @property
    def tabled_prior(self) -> PriorDistribution:
        """Prior of all parameters except the base's, from a prior run or else from the table."""
        size = self.size - self.tabled.start
        return self.run_prior or PriorDistribution(np.zeros(size), np.eye(size))

    def prior(self, name: str) -> tuple[FloatArray, FloatArray]:
        """Return the prior mean and covariance of a block, in units of the table's prior."""
        within = slice(self[name].start - self.tabled.start, self[name].stop - self.tabled.start)
        tabled = self.tabled_prior
        return tabled.mean[within], tabled.covariance[within, within]

    def with_prior(self, run_prior: PriorDistribution) -> Unknowns:
        """Return a copy with the prior from a prior run."""
        after = copy(self)
        after.run_prior = run_prior
        return after

    def estimates(self, name: str) -> bool:
        """Return True if a row is not fixed."""
        return self[name].stop > 0

    def columns(self, *names: str) -> NDArray[np.intp]:
        """Return the indices of some blocks in the vector, in the order of the names."""
        indices: NDArray[np.intp] = np.arange(self.size)
        return np.concatenate([indices[:0], *(indices[self[name]] for name in names)])

    def labels(self, row: Unknown) -> tuple[str, ...]:
        """Return the names of the parts that have one parameter of a row each."""
        return row.each.labels(self.robot)

    def start(self) -> FloatArray:
        """Return the (size,) values of the model."""
        x = np.zeros(self.size)
        x[self["base"]] = log_cholesky(self.model_base)
        return x

    def value(self, x: FloatArray, name: str) -> FloatArray:
        """Return a block in the unit of its row."""
        return self.values(x)[name]

    def values(self, x: FloatArray) -> Values:
        """Return all blocks of the table, in the units of their rows."""
        scaled = x * self.scale
        return {**self._model_values, **{row.name: scaled[self[row.name]] for row in self.rows}}

    def inertial(self, x: FloatArray) -> FloatArray:
        """Return the (10 + 4 links,) inertial parameters as in `momenta`."""
        links = self.of_links @ (x * self.scale)[self._links]
        return np.concatenate([base_vector(x[self["base"]]), self.model_links + links])

    def inertial_jacobian(self, x: FloatArray) -> FloatArray:
        """Return the (10 + 4 links, size) derivative of `inertial`."""
        jacobian = np.zeros((10 + len(self.model_links), self.size))
        jacobian[:10, self["base"]] = pin.LogCholeskyParameters(x[self["base"]]).calculateJacobian()
        jacobian[10:, self._links] = self.of_links * self.scale[self._links]
        return jacobian

    def base_body(self, x: FloatArray) -> InertialParameters:
        """Return the base's body."""
        return InertialParameters.from_vector(base_vector(x[self["base"]]))

    def robot_body(self, x: FloatArray) -> InertialParameters:
        """Return the whole robot frozen at the nominal stance, in the base frame."""
        return InertialParameters.from_vector(self.inertial(x) @ self._joined(x))

    def stance_effective_body(self, x: FloatArray) -> InertialParameters:
        """Return the paper's body: base, hips and thighs, about its own CoM."""
        return InertialParameters.from_vector(self.inertial(x) @ (self._joined(x) * self._above_knees))

    def _joined(self, x: FloatArray) -> FloatArray:
        """Return the (10 + 4 links, 10) matrix of `_joined_bodies`, with the leg shape of x if `composing` includes it."""
        if self.composing == INERTIAL:
            return self._joined_last[1]
        shape = x[self.columns(*LEG_SHAPE)]
        if not np.array_equal(shape, self._joined_last[0]):
            position = Traced(self.stance.joint_position[:, None])
            estimated = LegShape.of(self.legs, inputs_of(self.values(x), LEG_SHAPE, 1))
            com, model = (self.legs.traced_posture(position, legs).com.value[..., 0] for legs in (estimated, None))
            joined, _ = _joined_bodies(self.robot, self.stance, (com - model).T.reshape(-1, 3))
            self._joined_last = shape, joined
        return self._joined_last[1]


def _by_values(legs: LegChains) -> FloatArray:
    """Return the (4 links, parameters) derivative of the links' inertial parameters by the values of LINKS, in that order."""
    links, kinds = legs.links, legs.mass.shape[1]
    kind = np.tile(np.eye(kinds), (4, 1))
    # A CoM offset d is a first moment m d, in the link's frame.
    moments = legs.mass.reshape(-1, 1, 1) * legs.axes.reshape(-1, 3, 3)
    each = np.einsum("lij,lm->limj", moments, np.eye(links)).reshape(3 * links, -1)
    common = np.einsum("lij,lk->likj", moments[:, :, :2], kind).reshape(3 * links, -1)
    return np.asarray(
        block_diag(np.hstack([np.eye(links), np.ones((links, 1))]), np.hstack([each, common])), dtype=float
    )


def _joined_bodies(
    robot: RobotModel, stance: Stance, offset: FloatArray | float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Return the matrix that composes the parameters of `Unknowns.inertial` to one body, frozen at a stance.

    Args:
        offset: (links, 3) position of each leg link less the model's, in the base frame [m].

    Returns:
        (10 + 4 links, 10) parameters in the base frame, about its origin, of the base, each leg link and each moment;
        (10 + 4 links, 1) zero for parts below a knee, else one.
    """
    poses = Kinematics(robot).joint_poses(stance.joint_position)
    joints = [(leg, joint) for leg in robot.legs.values() for joint in leg.joint_ids]
    placed = [
        pin.SE3(poses[joint].rotation, poses[joint].translation + shift)
        for (_, joint), shift in zip(joints, np.broadcast_to(offset, (len(joints), 3)), strict=True)
    ]
    bodies = [pose.act(robot.pinocchio.inertias[joint]) for pose, (_, joint) in zip(placed, joints, strict=True)]
    moments = [(moment_parameters(body.lever) @ pose.rotation).T for body, pose in zip(bodies, placed, strict=True)]
    above = [float(joint != leg.joint_ids[-1]) for leg, joint in joints]
    joined = np.concatenate([np.eye(10), [body.toDynamicParameters() for body in bodies], *moments])
    return joined, np.concatenate([np.ones(10), above, np.repeat(above, 3)])[:, None]


def log_cholesky(body: InertialParameters) -> FloatArray:
    """Return the (10,) log-Cholesky parameters of a body (Rucker and Wensing 2022), in Pinocchio's order.

    Every vector is a physically consistent body: its pseudo-inertia is U U^T with an upper triangular U.
    """
    pseudo = np.array(pin.PseudoInertia.FromDynamicParameters(body.vector).toMatrix())
    upper = np.linalg.cholesky(pseudo[::-1, ::-1])[::-1, ::-1] / np.sqrt(body.mass)
    above_diagonal = upper[[0, 1, 0, 0, 1, 2], [1, 2, 2, 3, 3, 3]]
    return np.concatenate([[np.log(body.mass) / 2], np.log(np.diag(upper)[:3]), above_diagonal])


def base_vector(parameters: FloatArray) -> FloatArray:
    """Return the (10,) inertial parameters about the origin, in Pinocchio's order, from log-Cholesky parameters."""
    return np.array(pin.LogCholeskyParameters(parameters).toDynamicParameters())
