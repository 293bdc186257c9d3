"""MAP estimate of the parameters of all motors, by weighted least squares with priors (`solve.py`).

Priors of legs and rotors are those of the table of unknowns. Stribeck friction is included if the data require it
(`stribeck.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.optimize import lsq_linear

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.estimator.motors.delay import NOMINAL_DELAY, motor_trial
from equipoise.estimator.motors.equations import MotorSamples, motor_samples
from equipoise.estimator.motors.stribeck import SPEEDS, is_significant
from equipoise.estimator.solve import NormalEquations, solve
from equipoise.estimator.unknowns import Priors
from equipoise.recording.recording import Recording
from equipoise.recording.trials import MotorTrial
from equipoise.robot.model import LEG_NAMES, RobotModel
from equipoise.robot.scale import Scale
from equipoise.robot.stance import Stance

_ROUNDS = 3  # of renewed noise
_LEGS = Priors()  # of links and rotors
# Other prior standard deviations.
_GAIN = 0.05
_TORQUES = {
    "coulomb_friction": 2.0, "viscous_friction": 1.0, "armature": 0.1, "stribeck": 1.0, "offset": 0.3,
}  # [Nm], [Nm s/rad], [kg m2], [Nm], [Nm] on an A1  # fmt: skip
_UNEVEN = 0.01  # of Coulomb friction: residual of a smoothed reversal, which dominates without noise
# Differences between friction laws that fit sliding joints equally well, relative to Stribeck friction: at rest, in motion.
_AT_REST, _IN_MOTION = 0.3, 0.03
_LAG_SHARE = 0.1  # of a control period: prior of the time in it at which a command is read and a torque sampled
_DELAY = 3e-3  # [s], if torques are not reported
_INSTANT = 0.03  # of a control period: time between a board's own position sample and the reported one
_MODEL_ERROR = 3.0  # ratio of the total model error to its visible part, if friction depends on load


@dataclass(frozen=True, eq=False)
class MotorFit:
    """Estimated motor parameters. Torques are in the mean unit of the reported ones.

    Attributes:
        values: (4, nj) gain relative to the mean, minus one; Coulomb friction [Nm], viscous friction [Nm s/rad], armature
            [kg m2]. With Stribeck friction (5, nj), the last being the friction at rest beyond Coulomb's [Nm].
        covariance: (4 nj, 4 nj) or (5 nj, 5 nj) posterior covariance of `values`, row by row.
        delay: delay of the position loop and its standard deviation [s], if torques are not reported; else None.
        delay_and_friction: correlation of that delay with the mean viscous friction, or None.
        residual: (nj,) systematic part of the residual: rms of its means in bins of speed or load [Nm].
        model_error: (nj,) standard deviation of model errors that can bias parameters [Nm].
        repetition: number of averages with the same error.
        problem: problem whose solution this is.
    """

    values: FloatArray
    covariance: FloatArray
    delay: tuple[float, float] | None
    delay_and_friction: float | None
    residual: FloatArray
    model_error: FloatArray
    repetition: float
    problem: SwingProblem


class SwingProblem:
    """Least-squares problem of all motors: links, each joint's gain, terms and offset, the rotors' spin and the lag.

    Attributes:
        robot: model of the robot.
        samples: samples of the swings.
        stribeck_speed: speed of the Stribeck term [rad/s]; None: without it.
        joints: number of joints.
        model: (n, nj) torques according to the model file [Nm].
        links: (n, nj, k) columns of the links' parameters.
        terms: (n, nj) columns of friction and armature, by name.
        prior: (u,) prior standard deviations.
        start: (u,) prior means.
        x: (u,) best-fit parameters.
        covariance: (u, u) covariance of x for uncorrelated averages.
        residual: (n, nj) residual of the torques [Nm].
    """

    def __init__(self, robot: RobotModel, samples: MotorSamples, scale: Scale, stribeck_speed: float | None) -> None:
        self.robot, self.samples, self.stribeck_speed = robot, samples, stribeck_speed
        self.terms, shape = samples.terms(stribeck_speed), samples.torque.shape
        self.joints: int = shape[1]
        joints = [joint for leg in robot.legs.values() for joint in leg.joint_ids]
        each = np.array([_of_link(robot, samples.regressor, joint) for joint in joints])
        self.model: FloatArray = each[:, 0].sum(axis=0)
        of_kinds = each[:, 1:].reshape(len(robot.legs), -1, *shape).sum(axis=0)  # CoMs of all hips, thighs or calves
        self.links = np.stack([*each.reshape(-1, *shape), self.model, *of_kinds], axis=-1)
        com, common_com = _LEGS.link_com * scale.hip_height, _LEGS.link_com_common * scale.hip_height
        prior = [_LEGS.leg_mass, com, com, com] * len(joints)
        prior += [_LEGS.leg_mass_common, *[common_com] * len(of_kinds)]
        for own_prior in (_GAIN, *(_TORQUES[name] * scale.torque for name in (*self.terms, "offset"))):
            prior += [own_prior] * self.joints
        lag = _LAG_SHARE * samples.period if samples.reported else _DELAY
        self.prior = np.array([*prior, _LEGS.rotor_spin * scale.torque, lag])
        self.start = np.zeros(self.prior.size)
        self.start[-1] = samples.period / 2
        x, _ = solve(self, self.start, _ROUNDS)
        information = self.normal_equations(x).information
        self.covariance = np.asarray(np.linalg.inv(information), dtype=float)
        self.x = self._nearest(information, x)
        self.residual = self._residual(self.x)

    def of(self, name: str) -> slice:
        """Return the slice of a quantity of all joints."""
        start = self.links.shape[-1] + ("gain", *self.terms, "offset").index(name) * self.joints
        return slice(start, start + self.joints)

    @property
    def noise(self) -> FloatArray:
        """(nj,) root mean square of the residual [Nm]."""
        return positive_size(self.residual, self.samples.slides)

    @property
    def deviance(self) -> float:
        """Minus twice the log-likelihood, with noise as large as the residual."""
        return float((self.samples.slides.sum(axis=0) * np.log(self.noise**2)).sum())

    def linearised(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return predicted (n, nj) torques and their (n, nj, u) derivatives by the parameters."""
        links, joint, samples = self.links.shape[-1], np.arange(self.joints), self.samples
        kappa = 1 / (1 + x[self.of("gain")])
        moved = self.model + self.links @ x[:links] + samples.spin * x[-2]
        moved += sum(column * x[self.of(name)] for name, column in self.terms.items())
        design = np.zeros((*moved.shape, x.size))
        design[:, :, :links] = kappa[:, None] * self.links
        for name, column in self.terms.items():
            design[:, joint, joint + self.of(name).start] = kappa * column
        design[:, joint, joint + self.of("gain").start] = -(kappa**2) * moved
        design[:, joint, joint + self.of("offset").start] = 1.0
        design[:, :, -2] = kappa * samples.spin
        design[:, :, -1] = samples.kp * samples.command_rate
        return kappa * moved + x[self.of("offset")] + design[:, :, -1] * x[-1], design

    def prepare(self, x: FloatArray) -> None:
        """Set each joint's noise to its residual at x."""
        self._weight = self.samples.slides / positive_size(self._residual(x), self.samples.slides)

    def renew_noise(self, x: FloatArray) -> None:
        """Do nothing: `prepare` renews the noise."""

    def normal_equations(self, x: FloatArray, fix_scale: bool = False) -> NormalEquations:
        """Return the normal equations at x; the masses have no common scale to fix."""
        predicted, design = self.linearised(x)
        left = (predicted - self.samples.torque) * self._weight
        rows = (design * self._weight[..., None]).reshape(-1, x.size)
        return NormalEquations.of(left.ravel(), rows) + NormalEquations.of(
            (x - self.start) / self.prior, np.diag(1 / self.prior)
        )

    def _residual(self, x: FloatArray) -> FloatArray:
        return self.samples.torque - self.linearised(x)[0]

    def _nearest(self, information: FloatArray, x: FloatArray) -> FloatArray:
        """Return the most likely parameters with nonnegative friction and rotor inertia."""
        least = np.full(x.size, -np.inf)
        for name in self.terms:
            least[self.of(name)] = 0.0
        if (x >= least).all():
            return x
        root = np.asarray(np.linalg.cholesky(information).T, dtype=float)
        return lsq_linear(root, root @ x, (least, np.full(x.size, np.inf)), "bvls").x


def _of_link(robot: RobotModel, regressor: FloatArray, joint: int) -> FloatArray:
    """Return (4, n, nj) torques of the link that a joint moves, and of a shift of its CoM along each of its axes."""
    body, own = robot.pinocchio.inertias[joint], regressor[:, :, 10 * (joint - 1) : 10 * joint]
    return np.array([own @ body.toDynamicParameters(), *(body.mass * own[:, :, 1 + axis] for axis in range(3))])


def fit_motors(robot: RobotModel, samples: MotorSamples, scale: Scale) -> MotorFit:
    """Fit the motors, from the model file's legs; the noise is estimated from the residual."""
    problem = SwingProblem(robot, samples, scale, None)
    if _needs_stribeck(problem, _TORQUES["stribeck"] * scale.torque):
        solved = [SwingProblem(robot, samples, scale, speed) for speed in SPEEDS]
        problem = min(solved, key=lambda candidate: candidate.deviance)
    return _fit(problem)


@lru_cache(maxsize=2)  # a run for base and motors uses its swings for both
def fit_swings(robot: RobotModel, stance: Stance, swings: tuple[Recording, ...]) -> MotorFit:
    """Return the fit of all swings.

    Raises:
        RecordingError: a swing is too short.
    """
    return fit_motors(robot, motor_samples(robot, swings, stance.scale.time), stance.scale)


def complete_swings(recordings: Sequence[Recording]) -> list[Recording]:
    """Return the recordings of swings that were not interrupted."""
    return [recording for recording in recordings if isinstance(recording.trial, MotorTrial) and recording.complete]


def last_swings(recordings: Sequence[Recording]) -> list[Recording]:
    """Return the later of the last complete swings of all joints or of each leg; raises RecordingError if one is missing."""
    complete = complete_swings(recordings)
    if complete and motor_trial(complete[-1]).leg is None:
        return [complete[-1]]
    of_leg = {motor_trial(recording).leg: recording for recording in complete}
    if missing := [leg for leg in LEG_NAMES if leg not in of_leg]:
        of_what = f"the {' and '.join(missing)} leg" if complete else "all joints"
        raise RecordingError(
            f"there is no complete swing of {of_what}, and the motors' estimate needs all; record it with "
            "`equipoise calibrate --resume RUN`"
        )
    return [of_leg[leg] for leg in LEG_NAMES]


def _needs_stribeck(without: SwingProblem, prior: float) -> bool:
    """Test the residual of a solution without Stribeck friction for it.

    Args:
        prior: prior standard deviation of Stribeck friction [Nm].
    """
    samples, x = without.samples, without.x
    repetition = _repetition(without.residual / without.noise, samples.slides)
    noise = np.hypot(without.noise, _UNEVEN * x[without.of("coulomb_friction")])
    weight = samples.slides / noise / np.sqrt(repetition)
    _, design = without.linearised(x)
    terms = samples.stribeck * weight / (1 + x[without.of("gain")])
    return is_significant(
        terms, design * weight[..., None], without.residual * weight, repetition * without.covariance, prior
    )


def size(residual: FloatArray, used: FloatArray) -> FloatArray:
    """Return the (nj,) root mean square of the used rows."""
    return np.sqrt((residual**2 * used).sum(axis=0) / np.maximum(used.sum(axis=0), 1.0))


def positive_size(residual: FloatArray, used: FloatArray) -> FloatArray:
    """Return `size` as a divisor: never zero, even for joints that never slide."""
    return np.maximum(size(residual, used), np.finfo(float).tiny)


def _repetition(residual: FloatArray, used: FloatArray, most: int = 8) -> float:
    """Return the factor by which autocorrelated residuals overcount information; 1 for uncorrelated ones."""
    kept = np.where(used > 0, residual, 0.0)  # it is not finite for a joint that never slides
    power = float((kept**2).sum())
    alike = sum(float((kept[:-lag] * kept[lag:]).sum()) for lag in range(1, most))
    return max(1.0, 1.0 + 2.0 * alike / power) if power > 0 else 1.0


def _fit(problem: SwingProblem) -> MotorFit:
    """Express a solution relative to the mean gain, which only the legs' masses determine."""
    samples, x, residual, noise = problem.samples, problem.x, problem.residual, problem.noise
    repetition = _repetition(residual / noise, samples.slides)
    covariance, residual_level = repetition * problem.covariance, _residual_scale(samples, residual, repetition)
    model_error = _model_error(samples, residual_level)
    gain = 1 + x[problem.of("gain")]
    mean, joints = gain.mean(), problem.joints
    values = np.array([gain / mean - 1, *(x[problem.of(name)] / mean for name in problem.terms)])
    turn = np.zeros((len(values), joints, x.size))
    for row, name in enumerate(("gain", *problem.terms)):
        turn[row, :, problem.of(name)] = np.eye(joints) / mean
        turn[row, :, problem.of("gain")] -= ((gain if row == 0 else x[problem.of(name)]) / mean**2 / joints)[:, None]
    flat = turn.reshape(values.size, -1)
    delay = correlation = None
    if not samples.reported:
        lag_std = _LAG_SHARE * samples.period
        delay = NOMINAL_DELAY + x[-1] - samples.period / 2, float(np.sqrt(covariance[-1, -1] + lag_std**2))
        viscous_friction = flat[2 * joints : 3 * joints].mean(axis=0)
        shared = float(viscous_friction @ covariance[:, -1])
        correlation = shared / float(np.sqrt(viscous_friction @ covariance @ viscous_friction * covariance[-1, -1]))
    spread = flat @ covariance @ flat.T
    spread[np.diag_indices_from(spread)] += _error_variances(problem, model_error, values).ravel()
    return MotorFit(values, spread, delay, correlation, residual_level, model_error, repetition, problem)


def _model_error(samples: MotorSamples, residual_level: FloatArray) -> FloatArray:
    """Return (nj,) model errors that can bias parameters, from the systematic residuals [Nm].

    All gears of a robot are similar. An error visible in some joints, relative to their load, is assumed in all. A joint's own
    residual and the mean over all joints have equal weights.
    """
    carried = size(samples.torque, samples.slides)
    loaded = carried > 0
    common = np.sqrt(np.mean((residual_level[loaded] / carried[loaded]) ** 2)) if loaded.any() else 0.0
    return _MODEL_ERROR * np.sqrt((residual_level**2 + (common * carried) ** 2) / 2)


def _error_variances(problem: SwingProblem, model_error: FloatArray, values: FloatArray) -> FloatArray:
    """Return (k, nj) variances of `values` due to model errors, gains first.

    The model error may be in each term. A time difference between a board's own position sample and the reported one acts
    like viscous friction. Friction at rest is extrapolated from sliding joints.
    """
    samples, used = problem.samples, problem.samples.slides
    terms = samples.torque, *(problem.terms | {"coulomb_friction": np.ones_like(used)}).values()
    sizes = np.array([positive_size(term, used) for term in terms])
    variance = (model_error / sizes) ** 2
    variance[2] += (samples.kp * _INSTANT * samples.period) ** 2
    if problem.stribeck_speed is not None:
        variance[4] += (_AT_REST * values[4]) ** 2
        variance[1:3] += (_IN_MOTION * values[4] / sizes[1:3]) ** 2
    return variance


def _residual_scale(samples: MotorSamples, residual: FloatArray, repetition: float, bins: int = 8) -> FloatArray:
    """Return (nj,) rms of the residual's means in bins of speed or load, the larger one, beyond noise [Nm]."""
    largest = np.zeros(residual.shape[1])
    slowing, load = residual * np.sign(samples.sign), np.abs(samples.torque)
    for joint, used in enumerate(samples.slides.T > 0):
        for what, left in ((samples.velocity, residual), (load, slowing)):
            parts = np.array_split(left[used, joint][np.argsort(what[used, joint])], bins)
            squares = [part.mean() ** 2 - repetition * part.var() / len(part) for part in parts if len(part)]
            largest[joint] = max(largest[joint], sum(squares) / bins)
    return np.sqrt(largest)
