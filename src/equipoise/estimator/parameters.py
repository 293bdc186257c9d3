"""The vector that the Bayesian method estimates, and the bodies that it stands for."""

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
from equipoise.estimator.unknown import A1_TORQUE, Unknown
from equipoise.estimator.unknowns import Priors, Values, by_the_model, inputs_of
from equipoise.robot.inertial import InertialParameters, base_parameters, moment_parameters
from equipoise.robot.kinematics import Kinematics
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

LINKS = ("leg_mass", "leg_mass_common", "link_com", "link_com_common")
INERTIAL = ("base", *LINKS)
"""Unknowns that the inertial parameters are made of."""


@dataclass(frozen=True, eq=False)
class PriorDistribution:
    """What is believed of the table's unknowns beforehand, from an earlier run.

    Attributes:
        mean: (n,) most probable values, in units of their priors.
        covariance: (n, n) covariance of these.
    """

    mean: FloatArray
    covariance: FloatArray

    @cached_property
    def information(self) -> FloatArray:
        """(n, n) inverse of the covariance."""
        return np.asarray(np.linalg.inv(self.covariance), dtype=float)

    @cached_property
    def whitening(self) -> FloatArray:
        """(n, n) matrix that turns differences from the mean into white ones."""
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.covariance)), dtype=float)


class Unknowns:
    """The vector of unknowns: ten log-Cholesky parameters of the base, then everything else in units of its prior.

    Blocks are addressed by name: "base", and the names of the table's rows (unknowns.py).

    Attributes:
        rows: rows of the table of unknowns that are not held; the others have no place in the vector.
        size: length of the vector.
        legs: leg chains of the robot.
        scale: (size,) size of one unit of each unknown, in the unit of its row; one for the base.
        tabled: slice of all unknowns but the base's.
        torque_scale: m g h of the robot over that of an A1.
        model_links: (4 links,) inertial parameters of the leg links by the model, as of `momenta`.
        of_links: (4 links, open) derivative of these by the values of LINKS that are not held.
        composing: names of the unknowns that bodies are made of: the inertial ones; where the model's lengths or places of
            hips are not the robot's, also what legs are found to be like. Tolerances of a drawing do nothing that is seen.
        belief: what an earlier run says of them; None: there is none, and priors are as the table has them.
    """

    belief: PriorDistribution | None = None

    def __init__(self, robot: RobotModel, stance: Stance, priors: Priors) -> None:
        self.robot, self.stance, self.priors, self.rows = robot, stance, priors, priors.estimated
        self.torque_scale = A1_TORQUE.of(robot, stance)
        self._by_the_model = by_the_model(robot)
        self._slices = {"base": slice(0, 10), **dict.fromkeys(self._by_the_model, slice(0, 0))}
        self.scale: FloatArray = np.ones(10)
        for row in self.rows:
            own = np.full(len(self.labels(row)), getattr(priors, row.name) * row.measure.of(robot, stance))
            self._slices[row.name] = slice(len(self.scale), len(self.scale) + len(own))
            self.scale = np.concatenate([self.scale, own])
        self.size = len(self.scale)
        self.tabled = slice(10, self.size)
        self._links = self.columns(*LINKS)
        counts = [(self.estimates(name), len(self._by_the_model[name])) for name in LINKS]
        open_links = np.concatenate([np.full(count, estimated) for estimated, count in counts])
        self.legs = LegChains(robot)
        self.of_links, self.model_links = _by_values(self.legs)[:, open_links], model_parameters(robot)[10:]
        joined, self._above_knees = _joined_bodies(robot, stance)
        # Derivatives of bodies ask again and again with the same legs.
        self._joined_last = np.zeros(len(self.columns(*LEG_SHAPE))), joined
        found_shape = any(row.name in LEG_SHAPE for row in priors.not_of_this_robot)
        self.composing = (*INERTIAL, *LEG_SHAPE) if found_shape else INERTIAL
        self.model_base = base_parameters(robot)
        self.model_base_vector = self.model_base.vector

    def __getitem__(self, name: str) -> slice:
        return self._slices[name]

    def has(self, name: str) -> bool:
        """Whether the table has a row of a name."""
        return name in self._slices

    def believed(self, name: str) -> tuple[FloatArray, FloatArray]:
        """Mean and covariance of a block before the run, in units of its prior."""
        own = self[name]
        if self.belief is None:
            size = int(own.stop - own.start)
            return np.zeros(size), np.eye(size)
        within = slice(own.start - self.tabled.start, own.stop - self.tabled.start)
        return self.belief.mean[within], self.belief.covariance[within, within]

    def believing(self, belief: PriorDistribution) -> Unknowns:
        """The same unknowns after an earlier run."""
        after = copy(self)
        after.belief = belief
        return after

    def estimates(self, name: str) -> bool:
        """Whether the unknown of a row is not held."""
        return self[name].stop > 0

    def columns(self, *names: str) -> NDArray[np.intp]:
        """Places of some blocks in the vector, in the order of the names."""
        places: NDArray[np.intp] = np.arange(self.size)
        return np.concatenate([places[:0], *(places[self[name]] for name in names)])

    def labels(self, row: Unknown) -> tuple[str, ...]:
        """What there is one of an unknown of."""
        return row.each.labels(self.robot)

    def start(self) -> FloatArray:
        """(size,) the model's own values."""
        x = np.zeros(self.size)
        x[self["base"]] = log_cholesky(self.model_base)
        return x

    def value(self, x: FloatArray, name: str) -> FloatArray:
        """A block in its own units."""
        return self.values(x)[name]

    def values(self, x: FloatArray) -> Values:
        """All blocks of the table, in their own units."""
        scaled = x * self.scale
        return {**self._by_the_model, **{row.name: scaled[self[row.name]] for row in self.rows}}

    def inertial(self, x: FloatArray) -> FloatArray:
        """(10 + 4 links,) inertial parameters as of `momenta`."""
        links = self.of_links @ (x * self.scale)[self._links]
        return np.concatenate([base_vector(x[self["base"]]), self.model_links + links])

    def inertial_jacobian(self, x: FloatArray) -> FloatArray:
        """(10 + 4 links, size) derivative of `inertial`."""
        jacobian = np.zeros((10 + len(self.model_links), self.size))
        jacobian[:10, self["base"]] = pin.LogCholeskyParameters(x[self["base"]]).calculateJacobian()
        jacobian[10:, self._links] = self.of_links * self.scale[self._links]
        return jacobian

    def base_body(self, x: FloatArray) -> InertialParameters:
        """The base."""
        return InertialParameters.from_vector(base_vector(x[self["base"]]))

    def robot_body(self, x: FloatArray) -> InertialParameters:
        """The whole robot frozen at the nominal stance, in the base frame."""
        return InertialParameters.from_vector(self.inertial(x) @ self._joined(x))

    def stance_effective_body(self, x: FloatArray) -> InertialParameters:
        """The paper's body: base, hips and thighs, about its own CoM."""
        return InertialParameters.from_vector(self.inertial(x) @ (self._joined(x) * self._above_knees))

    def _joined(self, x: FloatArray) -> FloatArray:
        """(10 + 4 links, 10) as of `_joined_bodies`, with legs as they are found where bodies are composed so."""
        if self.composing == INERTIAL:
            return self._joined_last[1]
        shape = x[self.columns(*LEG_SHAPE)]
        if not np.array_equal(shape, self._joined_last[0]):
            position = Traced(self.stance.joint_position[:, None])
            found = LegShape.of(self.legs, inputs_of(self.values(x), LEG_SHAPE, 1))
            com, model = (self.legs.traced_posture(position, legs).com.value[..., 0] for legs in (found, None))
            joined, _ = _joined_bodies(self.robot, self.stance, (com - model).T.reshape(-1, 3))
            self._joined_last = shape, joined
        return self._joined_last[1]


def _by_values(legs: LegChains) -> FloatArray:
    """(4 links, unknowns) derivative of the links' inertial parameters by the values of LINKS, in that order."""
    links, kinds = legs.links, legs.mass.shape[1]
    kind = np.tile(np.eye(kinds), (4, 1))
    # A CoM off by d is a first moment m d, in the link's frame.
    moments = legs.mass.reshape(-1, 1, 1) * legs.axes.reshape(-1, 3, 3)
    each = np.einsum("lij,lm->limj", moments, np.eye(links)).reshape(3 * links, -1)
    common = np.einsum("lij,lk->likj", moments[:, :, :2], kind).reshape(3 * links, -1)
    return np.asarray(
        block_diag(np.hstack([np.eye(links), np.ones((links, 1))]), np.hstack([each, common])), dtype=float
    )


def _joined_bodies(robot: RobotModel, stance: Stance, aside: FloatArray | float = 0.0) -> tuple[FloatArray, FloatArray]:
    """What the inertial parameters of `Unknowns.inertial` add up to, frozen at a stance.

    Args:
        aside: (links, 3) place of each leg link less the model's, in the base frame [m].

    Returns:
        (10 + 4 links, 10) parameters in the base frame, about its origin, of the base, each leg link and each moment;
        (10 + 4 links, 1) one for what is not below a knee, else zero.
    """
    poses = Kinematics(robot).joint_poses(stance.joint_position)
    joints = [(leg, joint) for leg in robot.legs.values() for joint in leg.joint_ids]
    placed = [
        pin.SE3(poses[joint].rotation, poses[joint].translation + off)
        for (_, joint), off in zip(joints, np.broadcast_to(aside, (len(joints), 3)), strict=True)
    ]
    bodies = [place.act(robot.pinocchio.inertias[joint]) for place, (_, joint) in zip(placed, joints, strict=True)]
    turns = [place.rotation for place in placed]
    moments = [(moment_parameters(body.lever) @ turn).T for body, turn in zip(bodies, turns, strict=True)]
    above = [float(joint != leg.joint_ids[-1]) for leg, joint in joints]
    joined = np.concatenate([np.eye(10), [body.toDynamicParameters() for body in bodies], *moments])
    return joined, np.concatenate([np.ones(10), above, np.repeat(above, 3)])[:, None]


def log_cholesky(body: InertialParameters) -> FloatArray:
    """(10,) log-Cholesky parameters of a body (Rucker and Wensing 2022), in Pinocchio's order.

    Every vector is a body that can exist: its pseudo-inertia is U U^T with an upper triangular U.
    """
    about_origin = body.vector
    xx, xy, yy, xz, yz, zz = about_origin[4:]
    rotational = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    pseudo = np.empty((4, 4))
    pseudo[:3, :3] = np.trace(rotational) / 2 * np.eye(3) - rotational
    pseudo[:3, 3] = pseudo[3, :3] = about_origin[1:4]
    pseudo[3, 3] = body.mass
    upper = np.linalg.cholesky(pseudo[::-1, ::-1])[::-1, ::-1] / np.sqrt(body.mass)
    d1, d2, d3 = np.log(np.diag(upper)[:3])
    return np.array(
        [
            np.log(body.mass) / 2,
            d1,
            d2,
            d3,
            upper[0, 1],
            upper[1, 2],
            upper[0, 2],
            upper[0, 3],
            upper[1, 3],
            upper[2, 3],
        ]
    )


def base_vector(parameters: FloatArray) -> FloatArray:
    """(10,) inertial parameters about the origin, in Pinocchio's order, from log-Cholesky parameters."""
    return np.array(pin.LogCholeskyParameters(parameters).toDynamicParameters())
