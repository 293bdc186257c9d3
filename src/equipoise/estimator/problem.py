"""All evidence in one maximum a posteriori estimate, with its covariance.

Residuals, each in units of its own noise:

- tilt: y(t) of every lift trial (tilt_equation.py), less its mean, over the moment of inertia about the line. So divided it
  is an angular velocity, and the noise of the sensors in it does not depend on the unknowns: without that the noise in the
  regressors would pull the inertia towards zero.
- planted: feet that do not move, and footholds that keep their heights (planted_moves.py).
- torque: the balance of the planted robot (torque_balance.py), at the sensor biases of the last round.
- priors, and the mass from a scale.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.estimator.blocks.block import Misfit, ResidualBlock
from equipoise.estimator.blocks.planted import PlantedBlock
from equipoise.estimator.blocks.sway import SwayBlock
from equipoise.estimator.blocks.table import BLOCKS
from equipoise.estimator.blocks.tilt import TiltBlock
from equipoise.estimator.blocks.torque import TorqueBlock
from equipoise.estimator.measurements.evidence import RunEvidence
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.parameters import Belief, Unknowns
from equipoise.estimator.solve import NormalEquations, descend, solve
from equipoise.estimator.unknown import Unknown
from equipoise.estimator.unknowns import Priors
from equipoise.robot.inertial import COMPONENTS, InertialParameters, components
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

_ROOT_LENGTHS = 1.0  # prior of the logarithms of the base's root lengths: a factor of e
# Misfit that is expected before any is known. Were it one, what the equations leave out would outweigh all priors in the
# first round: without a scale, robots then lose their mass to motors that have no torque, and never find it again.
_MISFIT_AT_FIRST = 4.0
# How sure a robot that was not weighed is taken to be of its torque constants, or without torques of its mass, until noise
# levels are known: for the same reason.
_SCALE_AT_FIRST = 0.02


@dataclass(frozen=True, eq=False)
class Posterior:
    """The estimate.

    Attributes:
        problem: squared residuals that x makes least, at the noise levels of the last round.
        unknowns: layout of the vector x.
        x: (size,) most probable unknowns.
        covariance: (size, size) covariance of x.
        information: (size, size) information that each motion adds, by motion index.
        information_by_kind: the same by the kind of its equations.
        gradient: (size,) gradient of each motion's squared residuals, halved, by motion index.
        robot_body, base_body, stance_effective_body: bodies at the estimate.
        robot_covariance, base_covariance, stance_effective_covariance: (10, 10) covariance of each, in the order of
            COMPONENTS.
        prior_deviation, base_prior_deviation: (10,) standard deviations of the whole robot's and the base's parameters
            before any motion (a scale's mass not counted).
        informed: names of the unknowns that some evidence depends on.
        lifts, moves: misfits of the lifts and of the planted moves.
        torque_misfit: misfit of the torque rows; None without torques.
        converged: whether the last step was small; if not, something does not fit at all.
    """

    problem: MapProblem
    unknowns: Unknowns
    x: FloatArray
    covariance: FloatArray
    information: dict[int, FloatArray]
    information_by_kind: dict[type[ResidualBlock], FloatArray]
    gradient: dict[int, FloatArray]
    robot_body: InertialParameters
    base_body: InertialParameters
    stance_effective_body: InertialParameters
    robot_covariance: FloatArray
    base_covariance: FloatArray
    stance_effective_covariance: FloatArray
    prior_deviation: FloatArray
    base_prior_deviation: FloatArray
    informed: frozenset[str]
    lifts: tuple[Misfit, ...]
    moves: tuple[Misfit, ...]
    torque_misfit: float | None
    converged: bool

    @cached_property
    def whole_information(self) -> FloatArray:
        """(size, size) inverse of the covariance."""
        return np.asarray(np.linalg.inv(self.covariance), dtype=float)

    def without(self, motions: Collection[int]) -> tuple[FloatArray, FloatArray]:
        """(size,) change of x, and (size, size) covariance, if motions were left out; to first order.

        Args:
            motions: motion indices; of those that told nothing there is nothing to leave out.
        """
        left_out = [motion for motion in motions if motion in self.information]
        removed = sum((self.information[motion] for motion in left_out), np.zeros_like(self.covariance))
        pull = sum((self.gradient[motion] for motion in left_out), np.zeros(self.unknowns.size))
        covariance = np.asarray(np.linalg.inv(self.whole_information - removed), dtype=float)
        return covariance @ pull, covariance

    def of_row(self, row: Unknown) -> Iterator[tuple[str, float, float]]:
        """List the label, value and posterior standard deviation of each unknown of a row, in its own unit."""
        values = self.unknowns.value(self.x, row.name)
        for label, value, deviation in zip(self.unknowns.labels(row), values, self.deviation(row.name), strict=True):
            yield label, float(value), float(deviation)

    def deviation(self, name: str) -> FloatArray:
        """Posterior standard deviations of a block, in its own units."""
        block = self.unknowns[name]
        return np.sqrt(np.diag(self.covariance)[block]) * self.unknowns.scale[block]


def estimate_posterior(
    robot: RobotModel,
    stance: Stance,
    evidence: RunEvidence,
    priors: Priors | None = None,
    mass: tuple[float, float] | None = None,
    rounds: int = 2,
    lifts_needed: bool = True,
    quiet_feet: bool = False,
    sway_heard: bool = False,
) -> Posterior:
    """The most probable unknowns given all evidence.

    Args:
        mass: mass of the whole robot from a scale, and its standard deviation [kg].
        rounds: number of times that noise levels are renewed.
        lifts_needed: whether evidence without any lift is refused, or is estimated from as far as joint torques go.
        quiet_feet: whether planted feet are believed to be as quiet as they seem, or as restless as a floor may make them.
        sway_heard: whether a sway's word on where the IMU sits is evidence.

    Raises:
        RecordingError: no lift trial can be used; or there are no joint torques either.
    """
    problem = MapProblem(robot, stance, evidence, priors or Priors(), mass, lifts_needed, sway_heard)
    posterior = problem.posterior(*solve(problem, problem.unknowns.start(), rounds))
    if not quiet_feet:
        return posterior
    quiet = problem.at_found_noise(posterior)
    return quiet.posterior(*descend(quiet, posterior.x))


class MapProblem:
    """What one run adds to a maximum a posteriori estimate: residual blocks and priors, in a run's unknowns.

    Args:
        mass: mass of the whole robot from a scale, and its standard deviation [kg]; None: not known, or told elsewhere.
        lifts_needed: whether evidence without any lift is refused.
        sway_heard: whether a sway's word on where the IMU sits is evidence.

    Raises:
        RecordingError: no lift trial can be used; or there are no joint torques either.
    """

    def __init__(
        self, robot: RobotModel, stance: Stance, evidence: RunEvidence, priors: Priors, mass: tuple[float, float] | None,
        lifts_needed: bool, sway_heard: bool = False,
    ) -> None:  # fmt: skip
        self.mass = mass
        self.anchored = mass is None
        self.unknowns = Unknowns(robot, stance, priors)
        enough = any(motion.on_two_feet or (motion.torques and not lifts_needed) for motion in evidence.motions)
        if not enough:
            reasons = {motion.left_out for motion in evidence.motions if motion.left_out}
            raise RecordingError(f"no lift trial can be used: {'; '.join(sorted(reasons)) or 'there is none'}")
        legs = LegChains(robot)
        makers = (*BLOCKS, SwayBlock.of) if sway_heard else BLOCKS
        made = [make(self.unknowns, legs, evidence) for make in makers]
        self.blocks = [block for block in made if block is not None]
        for block in self.blocks:
            block.expect_misfit(_MISFIT_AT_FIRST)

    def with_all_open(self, x: FloatArray) -> tuple[MapProblem, FloatArray, NDArray[np.intp]]:
        """The same with no row held, at the noise levels as they are; x in its unknowns; and x's places there."""
        held, problem = self.unknowns, copy(self)
        problem.unknowns = Unknowns(held.robot, held.stance, held.priors.all_open)
        places = problem.unknowns.columns("base", *(row.name for row in held.rows))
        at = np.zeros(problem.unknowns.size)
        at[places] = x
        problem.blocks = [block.laid_out(problem.unknowns, at) for block in self.blocks]
        return problem, at, places

    def believing(self, belief: Belief) -> MapProblem:
        """The same after an earlier run, which says more than priors of the scale of masses too."""
        problem = copy(self)
        problem.unknowns, problem.anchored = self.unknowns.believing(belief), False
        return problem

    def at_shown_noise(self, x: FloatArray) -> MapProblem:
        """The same at the noise that feet on the floor show, where that is less than what is allowed for."""
        return self._with_feet(lambda planted: planted.at_shown_noise(x))

    def at_found_noise(self, posterior: Posterior) -> MapProblem:
        """The same at the noise that residuals of planted moves have at an estimate."""
        return self._with_feet(lambda planted: planted.at_found_noise(posterior.x, posterior.covariance))

    def _with_feet(self, quieted: Callable[[PlantedBlock], PlantedBlock]) -> MapProblem:
        problem = copy(self)
        problem.blocks = [quieted(block) if isinstance(block, PlantedBlock) else block for block in self.blocks]
        return problem

    def prepare(self, x: FloatArray) -> None:
        """Noise levels of a round."""
        for block in self.blocks:
            block.prepare(x)

    def renew_noise(self, x: FloatArray) -> None:
        """Raise the noise of what does not fit."""
        for block in self.blocks:
            block.renew_noise(x)

    def let_go(self) -> None:
        """Free the scale of all masses."""
        self.anchored = False

    def anchor(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residual that holds the scale of all masses where joint torques or else the model have it; its derivative."""
        if any(isinstance(block, TorqueBlock) and "torque_gain_common" in block.open for block in self.blocks):
            gain = self.unknowns["torque_gain_common"]
            tight = self.unknowns.scale[gain] / _SCALE_AT_FIRST
            return x[gain] * tight, np.eye(self.unknowns.size)[gain] * tight[:, None]
        total, derivative = total_mass(self.unknowns, x)
        noise = _SCALE_AT_FIRST * self.unknowns.robot.mass
        return np.array([total / noise - 1 / _SCALE_AT_FIRST]), derivative[None] / noise

    def evidence_equations(self, x: FloatArray) -> NormalEquations:
        """Of all blocks, without priors."""
        size = self.unknowns.size
        information, gradient, cost = np.zeros((size, size)), np.zeros(size), 0.0
        for block in self.blocks:
            residual, jacobian = block.linearise(x)
            information[np.ix_(block.columns, block.columns)] += jacobian.T @ jacobian
            gradient[block.columns] += jacobian.T @ residual
            cost += float(residual @ residual)
        return NormalEquations(information, gradient, cost)

    def normal_equations(self, x: FloatArray) -> NormalEquations:
        """Of all blocks and priors."""
        equations = self.evidence_equations(x) + NormalEquations.of(*prior_rows(self.unknowns, x, self.mass))
        return equations + NormalEquations.of(*self.anchor(x)) if self.anchored else equations

    def posterior(self, x: FloatArray, converged: bool) -> Posterior:
        """The estimate at x, with its covariance."""
        unknowns, start = self.unknowns, self.unknowns.start()
        by_motion: dict[int, FloatArray] = {}
        gradients: dict[int, FloatArray] = {}
        by_kind: dict[type[ResidualBlock], FloatArray] = {}
        for block in self.blocks:
            for motion, own, pull in block.by_motion(x):
                by_kind[type(block)] = by_kind.get(type(block), 0.0) + own
                by_motion[motion] = by_motion.get(motion, 0.0) + own
                gradients[motion] = gradients.get(motion, 0.0) + pull
        _, prior = prior_rows(unknowns, x, self.mass)
        covariance = np.asarray(np.linalg.inv(prior.T @ prior + sum(by_motion.values())), dtype=float)
        _, prior = prior_rows(unknowns, start, None)
        before = np.asarray(np.linalg.inv(prior.T @ prior), dtype=float)

        def spread(body: Callable[[FloatArray], InertialParameters], at: FloatArray, cov: FloatArray) -> FloatArray:
            jacobian = body_jacobian(unknowns, at, body)
            return np.asarray(jacobian @ cov @ jacobian.T, dtype=float)

        return Posterior(
            problem=self,
            unknowns=unknowns,
            x=x,
            covariance=covariance,
            information=by_motion,
            information_by_kind=by_kind,
            gradient=gradients,
            robot_body=unknowns.robot_body(x),
            base_body=unknowns.base_body(x),
            stance_effective_body=unknowns.stance_effective_body(x),
            robot_covariance=spread(unknowns.robot_body, x, covariance),
            base_covariance=spread(unknowns.base_body, x, covariance),
            stance_effective_covariance=spread(unknowns.stance_effective_body, x, covariance),
            prior_deviation=np.sqrt(np.diag(spread(unknowns.robot_body, start, before))),
            base_prior_deviation=np.sqrt(np.diag(spread(unknowns.base_body, start, before))),
            informed=frozenset(name for block in self.blocks for name in block.depends_on),
            lifts=tuple(misfit for block in self.blocks if isinstance(block, TiltBlock) for misfit in block.misfits(x)),
            moves=tuple(
                misfit for block in self.blocks if isinstance(block, PlantedBlock) for misfit in block.misfits(x)
            ),
            torque_misfit=next(
                (block.normalised_residual for block in self.blocks if isinstance(block, TorqueBlock)), None
            ),
            converged=converged,
        )


def body_jacobian(unknowns: Unknowns, x: FloatArray, body: Callable[[FloatArray], InertialParameters]) -> FloatArray:
    """(10, size) derivative of a body's parameters, in the order of COMPONENTS.

    Args:
        body: one of `unknowns.robot_body`, `base_body` and `stance_effective_body`.
    """
    jacobian = np.zeros((len(COMPONENTS), unknowns.size))
    for index in unknowns.columns(*unknowns.composing):
        ahead, behind = x.copy(), x.copy()
        ahead[index] += 1e-5
        behind[index] -= 1e-5
        jacobian[:, index] = (components(body(ahead)) - components(body(behind))) / 2e-5
    return jacobian


def prior_rows(unknowns: Unknowns, x: FloatArray, mass: tuple[float, float] | None) -> tuple[FloatArray, FloatArray]:
    """Residuals of the priors and of the scale, and their derivative."""
    residual, jacobian = body_prior_rows(unknowns, x, mass)
    rows = unknowns.tabled
    tabled, columns = x[rows], np.eye(unknowns.size)[rows]
    if unknowns.belief is not None:
        whitening = unknowns.belief.whitening
        tabled, columns = whitening @ (tabled - unknowns.belief.mean), whitening @ columns
    return np.concatenate([residual, tabled]), np.concatenate([jacobian, columns])


def body_prior_rows(
    unknowns: Unknowns, x: FloatArray, mass: tuple[float, float] | None
) -> tuple[FloatArray, FloatArray]:
    """The same, of the base and of the robot's mass alone."""
    priors, stance, robot = unknowns.priors, unknowns.stance, unknowns.robot
    model = unknowns.model_base_vector
    inertial, jacobian = unknowns.inertial(x), unknowns.inertial_jacobian(x)
    moment = np.array(priors.first_moment * model[0] * stance.hip_height)
    tensor = np.array(priors.inertia * max(model[4], model[6], model[9]))
    deviation = np.concatenate([np.full(3, moment), np.full(6, tensor)])
    rows = [(inertial[1:10] - model[1:]) / deviation]
    columns = [jacobian[1:10] / deviation[:, None]]
    # The three root lengths of the base: without this nothing holds them when a body shrinks to a plate that cannot exist,
    # and little evidence sends them there.
    lengths = slice(1, 4)
    rows.append((x[lengths] - unknowns.start()[lengths]) / _ROOT_LENGTHS)
    columns.append(np.eye(unknowns.size)[lengths] / _ROOT_LENGTHS)
    total, total_jacobian = total_mass(unknowns, x)
    rows.append(np.array([(total - robot.mass) / (priors.mass * robot.mass)]))
    columns.append(total_jacobian[None] / (priors.mass * robot.mass))
    if mass is not None:
        reading, derivative = _scale_reading(unknowns, x, total, total_jacobian)
        rows.append(np.array([(reading - mass[0]) / mass[1]]))
        columns.append(derivative[None] / mass[1])
    return np.concatenate(rows), np.concatenate(columns)


def _scale_reading(unknowns: Unknowns, x: FloatArray, total: float, derivative: FloatArray) -> tuple[float, FloatArray]:
    """What a scale reads of a mass, and the derivative of that: the mass itself, unless its gain is unknown."""
    if not unknowns.has("scale_gain"):
        return total, derivative
    gain = unknowns["scale_gain"]
    factor = 1 + float(unknowns.value(x, "scale_gain")[0])
    read = factor * derivative
    read[gain] += total * unknowns.scale[gain]
    return factor * total, read


def total_mass(unknowns: Unknowns, x: FloatArray) -> tuple[float, FloatArray]:
    """The robot's mass [kg], and its (size,) derivative."""
    of_links = LegChains(unknowns.robot).mass.ravel()
    masses = np.concatenate([np.eye(10)[0], of_links, np.zeros(3 * len(of_links))])
    return float(masses @ unknowns.inertial(x)), masses @ unknowns.inertial_jacobian(x)
