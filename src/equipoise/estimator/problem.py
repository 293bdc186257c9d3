"""Maximum a posteriori estimate from all motions, with its covariance.

Its residuals, in units of their noise, are those of the equations (equations/table.py), the priors and the scale reading.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.estimator.equations.equation import Equation, MotionResidual, MotionSamples
from equipoise.estimator.equations.imu_position import ExcitationSamples, imu_by_excitation
from equipoise.estimator.equations.table import USUAL
from equipoise.estimator.equations.tilt import TiltEquation
from equipoise.estimator.equations.torque_balance import TorqueBalance
from equipoise.estimator.parameters import PriorDistribution, Unknowns
from equipoise.estimator.solve import NormalEquations, descend, solve
from equipoise.estimator.unknowns import Priors, Unknown
from equipoise.robot.inertial import COMPONENTS, InertialParameters, components
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

E = TypeVar("E", bound=Equation[Any])
_LOG_DIAGONAL_STD = 1.0  # prior of the logarithms of the base's Cholesky diagonal: a factor of e
# Normalized residual of the first round. With a value of 1, unmodelled effects would outweigh all priors: without a scale, the
# mass then goes to zero together with the torque gains, and does not recover.
_FIRST_RESIDUAL = 4.0
# Std of the torque gain or, without torques, of the mass, until noise levels are known, if the robot was not weighed. The
# reason is the same.
_FIRST_SCALE_STD = 0.02


@dataclass(frozen=True, eq=False)
class Posterior:
    """Mode and covariance of the posterior.

    Attributes:
        problem: least-squares problem that x solves, at the noise levels of the last round.
        x: (size,) posterior mode.
        covariance: (size, size) covariance of x.
        information: (size, size) information of each motion, by motion index.
        information_by_equation: (size, size) information of each equation.
        gradient: (size,) gradient of each motion's squared residuals, halved, by motion index.
        normalized_residuals: residuals of the motions of each equation.
        converged: True if the last step was small.
    """

    problem: MapProblem
    x: FloatArray
    covariance: FloatArray
    information: Mapping[int, FloatArray]
    information_by_equation: Mapping[type[Equation[Any]], FloatArray]
    gradient: Mapping[int, FloatArray]
    normalized_residuals: Mapping[type[Equation[Any]], tuple[MotionResidual, ...]]
    converged: bool

    @property
    def unknowns(self) -> Unknowns:
        """Layout of the vector x."""
        return self.problem.unknowns

    @property
    def motions(self) -> tuple[MotionSamples, ...]:
        """Motions of the estimate, in order."""
        return self.problem.motions

    @property
    def informed(self) -> frozenset[str]:
        """Names of the parameters that some equation depends on."""
        return frozenset(name for equation in self.problem.equations for name in equation.depends_on)

    def residuals_of(self, equation: type[Equation[Any]]) -> tuple[MotionResidual, ...]:
        """Return the residuals of the motions of an equation; empty if there are none."""
        return self.normalized_residuals.get(equation, ())

    @cached_property
    def imu_by_excitation(self) -> tuple[FloatArray, FloatArray] | None:
        """IMU position less the model's from the run's first excitation, and its std [m]; None if there is none."""
        excitations = [excitation for motion in self.motions for excitation in motion.of(ExcitationSamples)]
        if not excitations:
            return None
        unknowns, values = self.unknowns, self.unknowns.values(self.x)
        return imu_by_excitation(unknowns.robot, unknowns.legs, excitations[0], values, unknowns.stance.scale)

    @cached_property
    def robot_body(self) -> InertialParameters:
        """Robot frozen at the nominal stance, in the base frame."""
        return self.unknowns.robot_body(self.x)

    @cached_property
    def robot_covariance(self) -> FloatArray:
        """(10, 10) covariance of the whole robot's parameters, in the order of COMPONENTS."""
        return self.covariance_of(self.unknowns.robot_body)

    def covariance_of(self, body: Callable[[FloatArray], InertialParameters]) -> FloatArray:
        """Return the (10, 10) covariance of a body's parameters, in the order of COMPONENTS."""
        jacobian = body_jacobian(self.unknowns, self.x, body)
        return np.asarray(jacobian @ self.covariance @ jacobian.T, dtype=float)

    @cached_property
    def _covariance_before(self) -> FloatArray:
        """(size, size) prior covariance of x, without a mass from a scale."""
        _, prior = prior_rows(self.unknowns, self.unknowns.start(), None)
        return np.asarray(np.linalg.inv(prior.T @ prior), dtype=float)

    def std_before(self, body: Callable[[FloatArray], InertialParameters]) -> FloatArray:
        """Return the (10,) prior standard deviations of a body's parameters, without a mass from a scale."""
        jacobian = body_jacobian(self.unknowns, self.unknowns.start(), body)
        return np.sqrt(np.diag(jacobian @ self._covariance_before @ jacobian.T))

    @cached_property
    def whole_information(self) -> FloatArray:
        """(size, size) inverse of the covariance."""
        return np.asarray(np.linalg.inv(self.covariance), dtype=float)

    def without(self, motions: Collection[int]) -> tuple[FloatArray, FloatArray]:
        """Return the (size,) change of x and the (size, size) covariance without some motions, to first order.

        Args:
            motions: motion indices; those without information are ignored.
        """
        left_out = [motion for motion in motions if motion in self.information]
        removed = sum((self.information[motion] for motion in left_out), np.zeros_like(self.covariance))
        gradient = sum((self.gradient[motion] for motion in left_out), np.zeros(self.unknowns.size))
        covariance = np.asarray(np.linalg.inv(self.whole_information - removed), dtype=float)
        return covariance @ gradient, covariance

    def of_row(self, row: Unknown) -> Iterator[tuple[str, float, float]]:
        """Yield the label, value and posterior standard deviation of each parameter of a row, in its unit."""
        values = self.unknowns.value(self.x, row.name)
        for label, value, std in zip(self.unknowns.labels(row), values, self.std(row.name), strict=True):
            yield label, float(value), float(std)

    def std(self, name: str) -> FloatArray:
        """Return the posterior standard deviations of a block, in the unit of its row."""
        block = self.unknowns[name]
        return np.sqrt(np.diag(self.covariance)[block]) * self.unknowns.scale[block]


def estimate_posterior(
    robot: RobotModel,
    stance: Stance,
    motions: Sequence[MotionSamples],
    priors: Priors | None = None,
    mass: tuple[float, float] | None = None,
    rounds: int = 2,
    lifts_needed: bool = True,
    quiet_feet: bool = False,
    equations: Sequence[type[Equation[Any]]] | None = None,
) -> Posterior:
    """Estimate the posterior from all motions.

    Args:
        mass: mass of the whole robot from a scale, and its standard deviation [kg].
        rounds: number of times that noise levels are renewed.
        lifts_needed: True to require a lift; False to accept joint torques alone.
        quiet_feet: True to take the noise of the feet in stance motions from their residuals, not from the worst floor.
        equations: equations to use; None: the usual ones.

    Raises:
        RecordingError: no lift trial can be used, nor joint torques where they suffice.
    """
    problem = MapProblem(robot, stance, motions, priors or Priors(), mass, lifts_needed, equations)
    posterior = problem.posterior(*solve(problem, problem.unknowns.start(), rounds))
    if not quiet_feet:
        return posterior
    quiet = problem.at_residual_noise(posterior.x, posterior.covariance)
    return quiet.posterior(*descend(quiet, posterior.x))


class MapProblem:
    """Least-squares problem of one run: equations and priors in the run's parameters.

    Args:
        mass: mass of the whole robot from a scale, and its standard deviation [kg]; None: not weighed, or given elsewhere.
        lifts_needed: True to require a lift; False to accept joint torques alone.
        equations: equations to use; None: the usual ones.

    Raises:
        RecordingError: no lift trial can be used, nor joint torques where they suffice.
    """

    def __init__(
        self, robot: RobotModel, stance: Stance, motions: Sequence[MotionSamples], priors: Priors,
        mass: tuple[float, float] | None, lifts_needed: bool = True, equations: Sequence[type[Equation[Any]]] | None = None,
    ) -> None:  # fmt: skip
        self.motions, self.mass = tuple(motions), mass
        self.unknowns = Unknowns(robot, stance, priors)
        optional = [equation.of(self.unknowns, motions) for equation in equations or USUAL]
        self.equations = [equation for equation in optional if equation is not None]
        needed = (TiltEquation,) if lifts_needed else (TiltEquation, TorqueBalance)
        if not any(self.equation(kind) for kind in needed):
            reasons = {motion.left_out for motion in motions if motion.left_out}
            raise RecordingError(f"no lift trial can be used: {'; '.join(sorted(reasons)) or 'the run has none'}")
        for equation in self.equations:
            equation.expect_residual(_FIRST_RESIDUAL)

    def equation(self, kind: type[E]) -> E | None:
        """Return the equation of this kind; None if no motion has samples for it."""
        return next((equation for equation in self.equations if isinstance(equation, kind)), None)

    def with_all_open(self, x: FloatArray) -> tuple[MapProblem, FloatArray, NDArray[np.intp]]:
        """Return this problem without fixed rows at the present noise levels, x in its parameters, and the indices of x."""
        fixed, problem = self.unknowns, copy(self)
        problem.unknowns = Unknowns(fixed.robot, fixed.stance, fixed.priors.all_open)
        indices = problem.unknowns.columns("base", *(row.name for row in fixed.rows))
        at = np.zeros(problem.unknowns.size)
        at[indices] = x
        problem.equations = [equation.laid_out(problem.unknowns, at) for equation in self.equations]
        return problem, at, indices

    def with_prior(self, run_prior: PriorDistribution) -> MapProblem:
        """Return a copy with the prior from a prior run."""
        problem = copy(self)
        problem.unknowns = self.unknowns.with_prior(run_prior)
        return problem

    def at_residual_noise(self, x: FloatArray, covariance: FloatArray | None = None) -> MapProblem:
        """Return a copy at the noise that residuals show; see `Equation.at_residual_noise`."""
        problem = copy(self)
        problem.equations = [equation.at_residual_noise(x, covariance) for equation in self.equations]
        return problem

    def prepare(self, x: FloatArray) -> None:
        """Set the noise levels of a round."""
        for equation in self.equations:
            equation.prepare(x)

    def renew_noise(self, x: FloatArray) -> None:
        """Raise the noise levels of trials with large residuals."""
        for equation in self.equations:
            equation.renew_noise(x)

    def scale_residual(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return a residual that fixes the torque gain, or without torques the total mass, and its derivative."""
        if any("torque_gain_common" in equation.open for equation in self.equations):
            gain = self.unknowns["torque_gain_common"]
            tight = self.unknowns.scale[gain] / _FIRST_SCALE_STD
            return x[gain] * tight, np.eye(self.unknowns.size)[gain] * tight[:, None]
        total, derivative = total_mass(self.unknowns, x)
        noise = _FIRST_SCALE_STD * self.unknowns.robot.mass
        return np.array([total / noise - 1 / _FIRST_SCALE_STD]), derivative[None] / noise

    def motion_equations(self, x: FloatArray) -> NormalEquations:
        """Return the normal equations of all equations, without priors."""
        size = self.unknowns.size
        information, gradient, cost = np.zeros((size, size)), np.zeros(size), 0.0
        for equation in self.equations:
            residual, jacobian = equation.linearise(x)
            information[np.ix_(equation.columns, equation.columns)] += jacobian.T @ jacobian
            gradient[equation.columns] += jacobian.T @ residual
            cost += float(residual @ residual)
        return NormalEquations(information, gradient, cost)

    def normal_equations(self, x: FloatArray, fix_scale: bool = False) -> NormalEquations:
        """Return the normal equations of all equations and priors; `fix_scale` has no effect with a scale or prior run."""
        equations = self.motion_equations(x) + NormalEquations.of(*prior_rows(self.unknowns, x, self.mass))
        fixed = fix_scale and self.mass is None and self.unknowns.run_prior is None
        return equations + NormalEquations.of(*self.scale_residual(x)) if fixed else equations

    def posterior(self, x: FloatArray, converged: bool) -> Posterior:
        """Return the posterior at its mode x."""
        by_motion: dict[int, FloatArray] = {}
        gradients: dict[int, FloatArray] = {}
        by_equation: dict[type[Equation[Any]], FloatArray] = {}
        for equation in self.equations:
            for motion, information, gradient in equation.by_motion(x):
                by_equation[type(equation)] = by_equation.get(type(equation), 0.0) + information
                by_motion[motion] = by_motion.get(motion, 0.0) + information
                gradients[motion] = gradients.get(motion, 0.0) + gradient
        _, prior = prior_rows(self.unknowns, x, self.mass)
        covariance = np.asarray(np.linalg.inv(prior.T @ prior + sum(by_motion.values())), dtype=float)
        normalized_residuals = {type(equation): equation.normalized_residuals(x) for equation in self.equations}
        return Posterior(self, x, covariance, by_motion, by_equation, gradients, normalized_residuals, converged)


def body_jacobian(unknowns: Unknowns, x: FloatArray, body: Callable[[FloatArray], InertialParameters]) -> FloatArray:
    """Return the (10, size) derivative of a body's parameters, in the order of COMPONENTS.

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
    """Return the residuals of the priors and of the scale, and their derivative."""
    residual, jacobian = body_prior_rows(unknowns, x, mass)
    rows = unknowns.tabled
    tabled, columns = x[rows], np.eye(unknowns.size)[rows]
    if unknowns.run_prior is not None:
        whitening = unknowns.run_prior.whitening
        tabled, columns = whitening @ (tabled - unknowns.run_prior.mean), whitening @ columns
    return np.concatenate([residual, tabled]), np.concatenate([jacobian, columns])


def body_prior_rows(
    unknowns: Unknowns, x: FloatArray, mass: tuple[float, float] | None
) -> tuple[FloatArray, FloatArray]:
    """Return the residuals of the priors of the base and the robot's mass and of the scale reading, and their derivative."""
    priors, stance, robot = unknowns.priors, unknowns.stance, unknowns.robot
    model = unknowns.model_base_vector
    inertial, jacobian = unknowns.inertial(x), unknowns.inertial_jacobian(x)
    moment = np.array(priors.first_moment * model[0] * stance.hip_height)
    tensor = np.array(priors.inertia * max(model[4], model[6], model[9]))
    std = np.concatenate([np.full(3, moment), np.full(6, tensor)])
    rows = [(inertial[1:10] - model[1:]) / std]
    columns = [jacobian[1:10] / std[:, None]]
    # Logarithms of the Cholesky diagonal. Without a prior, the body can degenerate to a plate if there are only a few motions.
    diagonal = slice(1, 4)
    rows.append((x[diagonal] - unknowns.start()[diagonal]) / _LOG_DIAGONAL_STD)
    columns.append(np.eye(unknowns.size)[diagonal] / _LOG_DIAGONAL_STD)
    total, total_jacobian = total_mass(unknowns, x)
    rows.append(np.array([(total - robot.mass) / (priors.mass * robot.mass)]))
    columns.append(total_jacobian[None] / (priors.mass * robot.mass))
    if mass is not None:
        reading, derivative = _scale_reading(unknowns, x, total, total_jacobian)
        rows.append(np.array([(reading - mass[0]) / mass[1]]))
        columns.append(derivative[None] / mass[1])
    return np.concatenate(rows), np.concatenate(columns)


def _scale_reading(unknowns: Unknowns, x: FloatArray, total: float, derivative: FloatArray) -> tuple[float, FloatArray]:
    """Return the reading of a scale with its gain, if that is estimated, and the derivative of the reading."""
    if not unknowns.has("scale_gain"):
        return total, derivative
    gain = unknowns["scale_gain"]
    factor = 1 + float(unknowns.value(x, "scale_gain")[0])
    of_reading = factor * derivative
    of_reading[gain] += total * unknowns.scale[gain]
    return factor * total, of_reading


def total_mass(unknowns: Unknowns, x: FloatArray) -> tuple[float, FloatArray]:
    """Return the robot's mass [kg] and its (size,) derivative."""
    of_links = unknowns.legs.mass.ravel()
    masses = np.concatenate([np.eye(10)[0], of_links, np.zeros(3 * len(of_links))])
    return float(masses @ unknowns.inertial(x)), masses @ unknowns.inertial_jacobian(x)
