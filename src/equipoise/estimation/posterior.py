"""All evidence in one maximum a posteriori estimate, with its covariance.

Residuals, each in units of its own noise:

- tilt: y(t) of every lift trial (tilt_equation.py), less its mean, over the moment of inertia about the line. So divided it
  is an angular velocity, and the noise of the sensors in it does not depend on the unknowns: without that the noise in the
  regressors would pull the inertia towards zero.
- planted: feet that do not move, and footholds that keep their heights (planted_moves.py).
- torque: the balance of the planted robot (torque_balance.py), at the sensor biases of the last round.
- priors, and the mass from a scale.

Gauss-Newton; noise levels of trials that fit worse than their sensors explain are raised, outliers left out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from equipoise.errors import RecordingError
from equipoise.estimation.evidence import Evidence
from equipoise.estimation.leg_motion import LegChains
from equipoise.estimation.parameters import COMPONENTS, Priors, Unknowns, components
from equipoise.estimation.residual_blocks import Misfit, PlantedBlock, TiltBlock, TorqueBlock
from equipoise.robot.inertial import InertialParameters
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

FloatArray = NDArray[np.float64]

_ITERATIONS = 8
_RENEWED = 2  # iteration of the first round at which the biases' columns are differentiated anew
_CONVERGED = 1e-2  # largest change of an unknown, in units of its posterior standard deviation
_NEARLY = 0.5  # of that: a step that large at the end is no end
_ROOT_LENGTHS = 1.0  # prior of the logarithms of the base's root lengths: a factor of e


@dataclass(frozen=True, eq=False)
class Posterior:
    """The estimate.

    Attributes:
        unknowns: layout of x.
        x: (size,) the estimate.
        covariance: (size, size).
        information: by motion index, (size, size): what each motion adds.
        gradient: by motion index, (size,): where each motion pulls.
        robot_body, base_body, stance_effective_body: at the estimate.
        robot_covariance, base_covariance, stance_effective_covariance: (10, 10) in the order of COMPONENTS.
        prior_deviation, base_prior_deviation: (10,) of the whole robot's and the base's parameters before any motion (a
            scale's mass not counted).
        lifts, moves: misfit of each.
        torque_chi: misfit of the torque rows; None without torques.
        converged: whether the last step was small; if not, something does not fit at all.
    """

    unknowns: Unknowns
    x: FloatArray
    covariance: FloatArray
    information: dict[int, FloatArray]
    gradient: dict[int, FloatArray]
    robot_body: InertialParameters
    base_body: InertialParameters
    stance_effective_body: InertialParameters
    robot_covariance: FloatArray
    base_covariance: FloatArray
    stance_effective_covariance: FloatArray
    prior_deviation: FloatArray
    base_prior_deviation: FloatArray
    lifts: tuple[Misfit, ...]
    moves: tuple[Misfit, ...]
    torque_chi: float | None
    converged: bool

    def deviation(self, name: str) -> FloatArray:
        """Posterior standard deviations of a block, in its own units."""
        block = self.unknowns[name]
        return np.sqrt(np.diag(self.covariance)[block]) * self.unknowns.scale[block]


def estimate_posterior(
    robot: RobotModel,
    stance: Stance,
    evidence: Evidence,
    priors: Priors | None = None,
    mass: tuple[float, float] | None = None,
    rounds: int = 2,
    lifts_needed: bool = True,
) -> Posterior:
    """The most probable unknowns given all evidence.

    Args:
        mass: of the whole robot from a scale, and its standard deviation [kg].
        rounds: how often noise levels are renewed.
        lifts_needed: whether evidence without any lift is refused, or is estimated from as far as joint torques go.

    Raises:
        RecordingError: no lift trial can be used; or there are no joint torques either.
    """
    problem = _Problem(robot, stance, evidence, priors or Priors(), mass, lifts_needed)
    try:
        return _solve(problem, rounds)
    except np.linalg.LinAlgError as error:
        raise RecordingError(f"the recordings do not determine an estimate: {error}") from error


def _solve(problem: _Problem, rounds: int) -> Posterior:
    x = problem.unknowns.start()
    for remaining in range(rounds, -1, -1):
        problem.prepare(x)
        x = problem.solve(x, first_round=remaining == rounds)
        if remaining:
            problem.renew_noise(x)
    return problem.posterior(x)


class _Problem:
    def __init__(
        self, robot: RobotModel, stance: Stance, evidence: Evidence, priors: Priors, mass: tuple[float, float] | None,
        lifts_needed: bool,
    ) -> None:  # fmt: skip
        self.mass = mass
        self.converged = False
        self.unknowns = Unknowns(robot, stance, priors)
        legs = LegChains(robot)
        lifts = [(motion.index, motion.lift) for motion in evidence.motions if motion.lift is not None]
        torques = [(motion.index, sample) for motion in evidence.motions for sample in motion.torques]
        if not lifts and (lifts_needed or not torques):
            reasons = {motion.left_out for motion in evidence.motions if motion.left_out}
            raise RecordingError(f"no lift trial can be used: {'; '.join(sorted(reasons)) or 'there is none'}")
        moves = [(motion.index, motion.move) for motion in evidence.motions if motion.move is not None]
        rotation = np.array(robot.imu_in_base.rotation)
        self.tilt = TiltBlock(self.unknowns, legs, rotation, lifts) if lifts else None
        self.planted = PlantedBlock(self.unknowns, legs, rotation, moves) if moves else None
        self.torque = TorqueBlock(self.unknowns, torques) if torques else None

    @property
    def blocks(self) -> list[TiltBlock | PlantedBlock | TorqueBlock]:
        return [block for block in (self.tilt, self.planted, self.torque) if block is not None]

    def prepare(self, x: FloatArray) -> None:
        for block in self.blocks:
            block.prepare(x)

    def renew_noise(self, x: FloatArray) -> None:
        for block in self.blocks:
            block.renew_noise(x)

    def cost(self, x: FloatArray) -> float:
        parts = [block.residual(x) for block in self.blocks]
        parts.append(prior_rows(self.unknowns, x, self.mass)[0])
        return float(sum(part @ part for part in parts))

    def normal_equations(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        residual, jacobian = prior_rows(self.unknowns, x, self.mass)
        information, gradient = jacobian.T @ jacobian, jacobian.T @ residual
        for block in self.blocks:
            residual, jacobian = block.residual(x), block.jacobian(x)
            information += jacobian.T @ jacobian
            gradient += jacobian.T @ residual
        return information, gradient

    def solve(self, x: FloatArray, first_round: bool) -> FloatArray:
        """Gauss-Newton with halved steps; where no part of a step helps, the biases' columns are out of date."""
        cost, full, deviation = self.cost(x), np.full(len(x), np.inf), np.ones(len(x))
        renew = True
        for iteration in range(_ITERATIONS):
            renewed = renew or (first_round and iteration == _RENEWED)
            if renewed:
                for block in self.blocks:
                    block.differentiate(x)
            renew = False
            information, gradient = self.normal_equations(x)
            full = -np.linalg.solve(information, gradient)
            deviation = np.sqrt(np.diag(np.linalg.inv(information)))
            for part in 0.5 ** np.arange(8):
                tried = self.cost(x + part * full)
                if tried <= cost * (1 + 1e-9):
                    x, cost = x + part * full, tried
                    break
            else:
                if renewed:
                    break
                renew = True
            if (np.abs(full) < _CONVERGED * deviation).all():
                break
        self.converged = bool((np.abs(full) < _NEARLY * deviation).all())
        return x

    def posterior(self, x: FloatArray) -> Posterior:
        information, _ = self.normal_equations(x)
        covariance = np.asarray(np.linalg.inv(information), dtype=float)
        by_motion: dict[int, FloatArray] = {}
        gradients: dict[int, FloatArray] = {}
        for block in self.blocks:
            residual, jacobian = block.residual(x), block.jacobian(x)
            for motion, rows in block.motions:
                by_motion[motion] = by_motion.get(motion, 0.0) + jacobian[rows].T @ jacobian[rows]
                gradients[motion] = gradients.get(motion, 0.0) + jacobian[rows].T @ residual[rows]
        unknowns, start = self.unknowns, self.unknowns.start()
        _, prior = prior_rows(unknowns, start, None)
        before = np.asarray(np.linalg.inv(prior.T @ prior), dtype=float)

        def spread(body: Callable[[FloatArray], InertialParameters], at: FloatArray, cov: FloatArray) -> FloatArray:
            jacobian = body_jacobian(unknowns, at, body)
            return np.asarray(jacobian @ cov @ jacobian.T, dtype=float)

        return Posterior(
            unknowns=unknowns,
            x=x,
            covariance=covariance,
            information=by_motion,
            gradient=gradients,
            robot_body=unknowns.robot_body(x),
            base_body=unknowns.base_body(x),
            stance_effective_body=unknowns.stance_effective_body(x),
            robot_covariance=spread(unknowns.robot_body, x, covariance),
            base_covariance=spread(unknowns.base_body, x, covariance),
            stance_effective_covariance=spread(unknowns.stance_effective_body, x, covariance),
            prior_deviation=np.sqrt(np.diag(spread(unknowns.robot_body, start, before))),
            base_prior_deviation=np.sqrt(np.diag(spread(unknowns.base_body, start, before))),
            lifts=() if self.tilt is None else self.tilt.misfits(x),
            moves=() if self.planted is None else self.planted.misfits(x),
            torque_chi=None if self.torque is None else self.torque.chi,
            converged=self.converged,
        )


def body_jacobian(unknowns: Unknowns, x: FloatArray, body: Callable[[FloatArray], InertialParameters]) -> FloatArray:
    """(10, size) derivative of a body's parameters, in the order of COMPONENTS.

    Args:
        body: one of `unknowns.robot_body`, `base_body` and `stance_effective_body`.
    """
    jacobian = np.zeros((len(COMPONENTS), unknowns.size))
    for index in range(unknowns["links"].stop):
        ahead, behind = x.copy(), x.copy()
        ahead[index] += 1e-5
        behind[index] -= 1e-5
        jacobian[:, index] = (components(body(ahead)) - components(body(behind))) / 2e-5
    return jacobian


def prior_rows(unknowns: Unknowns, x: FloatArray, mass: tuple[float, float] | None) -> tuple[FloatArray, FloatArray]:
    """Residuals of the priors and of the scale, and their derivative."""
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
    total, total_jacobian = inertial[0], jacobian[0].copy()
    leg_mass = LegChains(robot).mass.ravel()
    total = total + leg_mass @ inertial[10:]
    total_jacobian += leg_mass @ jacobian[10:]
    known = [(robot.mass, priors.mass * robot.mass)] + ([] if mass is None else [mass])
    for value, sd in known:
        rows.append(np.array([(total - value) / sd]))
        columns.append(total_jacobian[None] / sd)
    rows.append(x[10:])
    columns.append(np.eye(unknowns.size)[10:])
    return np.concatenate(rows), np.concatenate(columns)
