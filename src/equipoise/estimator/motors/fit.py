"""Unknowns of all motors from one weighted least squares, with what was believed before (a MAP estimate).

Friction that grows toward rest is among them where the data want it (`stribeck.py`); elsewhere the fit is made without.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.optimize import lsq_linear

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.estimator.motors.delay import THOUGHT_DELAY, motor_trial
from equipoise.estimator.motors.equations import MotorSamples, motor_samples
from equipoise.estimator.motors.stribeck import SPEEDS, is_wanted
from equipoise.recording.recording import Recording
from equipoise.recording.trials import MotorTrial
from equipoise.robot.model import LEG_NAMES, RobotModel
from equipoise.robot.scale import Scale
from equipoise.robot.stance import Stance

_ROUNDS = 6
# Standard deviations before the run: legs may be off the file's as those of `bayesian` may.
_MASS_COMMON, _MASS, _COM_COMMON, _COM = 0.10, 0.05, 4e-3, 2e-3  # of a link's mass; [m] on an A1
_GAIN = 0.05
_COULOMB, _VISCOUS, _ARMATURE, _OFFSET = 2.0, 1.0, 0.1, 0.3  # [Nm], [Nm s/rad], [kg m2], [Nm] on an A1
_STRIBECK = 1.0  # [Nm] on an A1
_UNEVEN = 0.01  # of Coulomb friction: a turn's smoothing leaves that, which shows where there is no noise
# Of friction that grows toward rest: laws that say nearly the same where joints slide differ by that at rest, and in motion.
_AT_REST, _IN_MOTION = 0.3, 0.03
_SPIN = 1.5e-3  # [kg m2] on an A1: an armature of 0.01 over gear ratios of six to ten
_LAG_SHARE = 0.1  # of a control period: how well it is known when in it a command is taken and a torque sampled
_DELAY = 3e-3  # [s], where it is only told by the motion
_INSTANT = 0.03  # of a control period, by which a board may feel a joint's position earlier or later than it says
_LIKE = 3.0  # times a misfit that is seen is one that is not, where friction follows load


@dataclass(frozen=True, eq=False)
class MotorFit:
    """What was found. Joint quantities are in the unit in which motors report torques on average.

    Attributes:
        values: (4, nj) gain less one, relative to the mean; Coulomb [Nm], viscous friction [Nm s/rad], armature [kg m2]. Where
            friction grows toward rest (5, nj), the last being what it is at rest beyond Coulomb's [Nm].
        covariance: (4 nj, 4 nj) or (5 nj, 5 nj) posterior covariance of the same, row by row.
        stribeck_speed: speed with which that falls [rad/s]; None: the data do not want it.
        delay: delay of the position loop and its standard deviation [s], where the motion alone tells it; else None.
        delay_and_friction: correlation of that delay with the mean viscous friction, or None.
        noise: (nj,) standard deviation of what is left of the averaged torques [Nm].
        normalized_residual: (nj,) how much of that repeats with a joint's speed or its load: the rms of its means in bins of
            either [Nm].
        unseen: (nj,) what may be of that kind and look like an unknown [Nm].
        repetition: number of averages that say what one says.
        gain: (nj,) true over reported torque by the fit, what all have in common with it, which nothing but legs tells.
        carried: (n, nj) true torques by the fit, of legs, friction and rotors [Nm].
    """

    values: FloatArray
    covariance: FloatArray
    stribeck_speed: float | None
    delay: tuple[float, float] | None
    delay_and_friction: float | None
    noise: FloatArray
    normalized_residual: FloatArray
    unseen: FloatArray
    repetition: float
    gain: FloatArray
    carried: FloatArray


@dataclass(frozen=True, eq=False)
class _Table:
    """Columns of the unknowns: links first, then each joint's gain, terms and offset, then the rotors' spin and the lag."""

    model: FloatArray  # (n, nj): torques by the model file
    links: FloatArray  # (n, nj, k)
    terms: dict[str, FloatArray]  # (n, nj) each
    prior: FloatArray  # (u,)
    stribeck_speed: float | None

    @property
    def joints(self) -> int:
        """Number of joints."""
        return self.model.shape[1]

    def of(self, name: str) -> slice:
        """Where a quantity of all joints is."""
        start = self.links.shape[-1] + ("gain", *self.terms, "offset").index(name) * self.joints
        return slice(start, start + self.joints)


@dataclass(frozen=True, eq=False)
class _Solution:
    """Unknowns that fit best."""

    x: FloatArray  # (u,)
    covariance: FloatArray  # (u, u), did no average resemble its neighbours
    residual: FloatArray  # (n, nj): what is left of the torques [Nm]


def fit_motors(robot: RobotModel, samples: MotorSamples, scale: Scale) -> MotorFit:
    """Gauss-Newton from the model file's legs; the residual's size is found on the way."""
    table = _table(robot, samples, scale, None)
    solution = _solve(table, samples)
    if _wants_stribeck(table, samples, scale, solution):
        tables = [_table(robot, samples, scale, speed) for speed in SPEEDS]
        solved = [(table, _solve(table, samples)) for table in tables]
        table, solution = min(solved, key=lambda one: _left(samples, one[1]))
    return _fit(table, samples, solution)


@lru_cache(maxsize=2)  # a run for base and motors uses its swings for both
def fit_swings(robot: RobotModel, stance: Stance, swings: tuple[Recording, ...]) -> tuple[MotorSamples, MotorFit]:
    """The samples of all swings, and their fit.

    Raises:
        RecordingError: a swing is too short.
    """
    samples = motor_samples(robot, swings, stance.scale.time)
    return samples, fit_motors(robot, samples, stance.scale)


def complete_swings(recordings: Sequence[Recording]) -> list[Recording]:
    """The recordings of swings that were not interrupted."""
    return [recording for recording in recordings if isinstance(recording.trial, MotorTrial) and recording.complete]


def last_swings(recordings: Sequence[Recording]) -> list[Recording]:
    """The last complete swing of all joints, or of each leg, whichever came last; raises RecordingError if one is missing."""
    complete = complete_swings(recordings)
    if complete and motor_trial(complete[-1]).leg is None:
        return [complete[-1]]
    of_leg = {motor_trial(recording).leg: recording for recording in complete}
    if missing := [leg for leg in LEG_NAMES if leg not in of_leg]:
        of_what = f"the {' and '.join(missing)} leg" if complete else "all joints"
        raise RecordingError(
            f"the recordings hold no complete swing of {of_what}, and motors are told apart by all; `equipoise calibrate "
            "--resume RUN` does what is missing"
        )
    return [of_leg[leg] for leg in LEG_NAMES]


def _left(samples: MotorSamples, solution: _Solution) -> float:
    """Twice the negative logarithm of the likelihood of noise that is as large as what is left."""
    used = samples.slides
    return float((used.sum(axis=0) * np.log(positive_size(solution.residual, used) ** 2)).sum())


def _solve(table: _Table, samples: MotorSamples) -> _Solution:
    start = np.zeros(table.prior.size)
    start[-1] = samples.period / 2
    x, residual = start.copy(), samples.torque
    covariance: FloatArray = np.diag(table.prior**2)
    for _ in range(_ROUNDS):
        predicted, design = _linearised(table, samples, x)
        weight = samples.slides / positive_size(residual, samples.slides)
        rows = (design * weight[..., None]).reshape(-1, x.size)
        left = ((samples.torque - predicted) * weight).reshape(-1)
        normal = rows.T @ rows + np.diag(table.prior**-2)
        covariance = np.asarray(np.linalg.inv(normal), dtype=float)
        x = _nearest(table, normal, x + covariance @ (rows.T @ left + (start - x) / table.prior**2))
        residual = samples.torque - _linearised(table, samples, x)[0]
    return _Solution(x, covariance, residual)


def _wants_stribeck(table: _Table, samples: MotorSamples, scale: Scale, without: _Solution) -> bool:
    """Whether a solution without friction that grows toward rest wants it."""
    repetition = _repetition(without.residual / positive_size(without.residual, samples.slides), samples.slides)
    noise = np.hypot(positive_size(without.residual, samples.slides), _UNEVEN * without.x[table.of("coulomb_friction")])
    weight = samples.slides / noise / np.sqrt(repetition)
    _, design = _linearised(table, samples, without.x)
    terms = samples.stribeck * weight / (1 + without.x[table.of("gain")])
    prior = prior_stds(samples, scale)["stribeck"]
    return is_wanted(
        terms, design * weight[..., None], without.residual * weight, repetition * without.covariance, prior
    )


def _nearest(table: _Table, normal: FloatArray, x: FloatArray) -> FloatArray:
    """The likeliest unknowns of motors that could be: no friction and no rotor is less than none."""
    least = np.full(x.size, -np.inf)
    for name in table.terms:
        least[table.of(name)] = 0.0
    if (x >= least).all():
        return x
    root = np.asarray(np.linalg.cholesky(normal).T, dtype=float)
    return lsq_linear(root, root @ x, (least, np.full(x.size, np.inf)), "bvls").x


def _table(robot: RobotModel, samples: MotorSamples, scale: Scale, stribeck_speed: float | None) -> _Table:
    model, columns, prior = np.zeros_like(samples.torque), list[FloatArray](), list[float]()
    of_kind: dict[tuple[int, int], FloatArray] = {}
    for leg in robot.legs.values():
        for kind, joint in enumerate(leg.joint_ids):
            body, part = robot.pinocchio.inertias[joint], samples.regressor[:, :, 10 * (joint - 1) : 10 * joint]
            whole = part @ body.toDynamicParameters()
            model += whole
            unknown = [whole, *(body.mass * part[:, :, 1 + axis] for axis in range(3))]
            columns += unknown
            prior += [_MASS, *[_COM * scale.length] * 3]
            for axis, column in enumerate(unknown):
                shared = (-1, 0) if axis == 0 else (kind, axis)  # the common error of masses is that of all links
                of_kind[shared] = of_kind.get(shared, np.zeros_like(model)) + column
    columns += of_kind.values()
    prior += [_MASS_COMMON if axis == 0 else _COM_COMMON * scale.length for _, axis in of_kind]
    sizes, joints = prior_stds(samples, scale), samples.torque.shape[1]
    terms = samples.terms(stribeck_speed)
    for name in ("gain", *terms, "offset"):
        prior += [sizes[name]] * joints
    prior += [sizes["spin"], sizes["lag"]]
    return _Table(model, np.stack(columns, axis=-1), terms, np.array(prior), stribeck_speed)


def prior_stds(samples: MotorSamples, scale: Scale) -> dict[str, float]:
    """What is believed beforehand of each joint's gain, terms and offset, of the rotors' spin and of the lag."""
    sizes = {
        "coulomb_friction": _COULOMB, "viscous_friction": _VISCOUS, "armature": _ARMATURE, "stribeck": _STRIBECK,
        "offset": _OFFSET,
        "spin": _SPIN,
    }  # fmt: skip
    lag = _LAG_SHARE * samples.period if samples.reported else _DELAY
    return {"gain": _GAIN, **{name: own * scale.torque for name, own in sizes.items()}, "lag": lag}


def _linearised(table: _Table, samples: MotorSamples, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n, nj) torques by the equation, and (n, nj, u) their derivatives by the unknowns."""
    links, joint = table.links.shape[-1], np.arange(table.joints)
    kappa = 1 / (1 + x[table.of("gain")])
    moved = table.model + table.links @ x[:links] + samples.spin * x[-2]
    moved += sum(column * x[table.of(name)] for name, column in table.terms.items())
    design = np.zeros((*moved.shape, x.size))
    design[:, :, :links] = kappa[:, None] * table.links
    for name, column in table.terms.items():
        design[:, joint, joint + table.of(name).start] = kappa * column
    design[:, joint, joint + table.of("gain").start] = -(kappa**2) * moved
    design[:, joint, joint + table.of("offset").start] = 1.0
    design[:, :, -2] = kappa * samples.spin
    design[:, :, -1] = samples.kp * samples.command_rate
    return kappa * moved + x[table.of("offset")] + design[:, :, -1] * x[-1], design


def size(residual: FloatArray, used: FloatArray) -> FloatArray:
    """(nj,) root mean square of the rows that count."""
    return np.sqrt((residual**2 * used).sum(axis=0) / np.maximum(used.sum(axis=0), 1.0))


def positive_size(residual: FloatArray, used: FloatArray) -> FloatArray:
    """As `size`, to divide by: it is never zero, also of joints that never slide."""
    return np.maximum(size(residual, used), np.finfo(float).tiny)


def _repetition(residual: FloatArray, used: FloatArray, most: int = 8) -> float:
    """How many times a row's information is counted because residuals resemble their neighbours; 1: not at all."""
    kept = np.where(used > 0, residual, 0.0)  # of a joint that never slides it is beyond all numbers
    power = float((kept**2).sum())
    alike = sum(float((kept[:-lag] * kept[lag:]).sum()) for lag in range(1, most))
    return max(1.0, 1.0 + 2.0 * alike / power) if power > 0 else 1.0


def _fit(table: _Table, samples: MotorSamples, solution: _Solution) -> MotorFit:
    """Relative to the mean gain, which nothing but the legs' masses tells."""
    x, residual = solution.x, solution.residual
    sigma = positive_size(residual, samples.slides)
    repetition = _repetition(residual / sigma, samples.slides)
    covariance, normalized_residual = repetition * solution.covariance, _residual_scale(samples, residual, repetition)
    unseen = _unseen(samples, normalized_residual)
    gain = 1 + x[table.of("gain")]
    mean, joints = gain.mean(), table.joints
    values = np.array([gain / mean - 1, *(x[table.of(name)] / mean for name in table.terms)])
    turn = np.zeros((len(values), joints, x.size))
    for row, name in enumerate(("gain", *table.terms)):
        turn[row, :, table.of(name)] = np.eye(joints) / mean
        turn[row, :, table.of("gain")] -= ((gain if row == 0 else x[table.of(name)]) / mean**2 / joints)[:, None]
    flat = turn.reshape(values.size, -1)
    delay = correlation = None
    if not samples.reported:
        known = _LAG_SHARE * samples.period
        delay = THOUGHT_DELAY + x[-1] - samples.period / 2, float(np.sqrt(covariance[-1, -1] + known**2))
        viscous_friction = flat[2 * joints : 3 * joints].mean(axis=0)
        shared = float(viscous_friction @ covariance[:, -1])
        correlation = shared / float(np.sqrt(viscous_friction @ covariance @ viscous_friction * covariance[-1, -1]))
    found = flat @ covariance @ flat.T
    found[np.diag_indices_from(found)] += _unlike_law(table, samples, unseen, values).ravel()
    carried = gain * (samples.torque - residual - x[table.of("offset")] - samples.kp * samples.command_rate * x[-1])
    return MotorFit(
        values,
        found,
        table.stribeck_speed,
        delay,
        correlation,
        sigma,
        normalized_residual,
        unseen,
        repetition,
        gain,
        carried,
    )


def _unseen(samples: MotorSamples, normalized_residual: FloatArray) -> FloatArray:
    """(nj,) what repeats and looks like an unknown, by what repeats and does not [Nm].

    A robot's gears are of one kind. What some joints show of theirs, as a share of what they carry, others have as well and
    happen not to show: a joint counts for half, and all of them for the other.
    """
    carried = size(samples.torque, samples.slides)
    loaded = carried > 0
    common = np.sqrt(np.mean((normalized_residual[loaded] / carried[loaded]) ** 2)) if loaded.any() else 0.0
    return _LIKE * np.sqrt((normalized_residual**2 + (common * carried) ** 2) / 2)


def _unlike_law(table: _Table, samples: MotorSamples, unseen: FloatArray, values: FloatArray) -> FloatArray:
    """(k, nj) variances of `values`, of gains first, for motors that do not obey the equation.

    What is unseen may be in each term. And a board may feel position at another instant than it reports it, which looks like
    viscous friction. What friction grows to at rest is beyond what is seen.
    """
    used = samples.slides
    terms = samples.torque, *(table.terms | {"coulomb_friction": np.ones_like(used)}).values()
    sizes = np.array([positive_size(term, used) for term in terms])
    variance = (unseen / sizes) ** 2
    variance[2] += (samples.kp * _INSTANT * samples.period) ** 2
    if table.stribeck_speed is not None:
        variance[4] += (_AT_REST * values[4]) ** 2
        variance[1:3] += (_IN_MOTION * values[4] / sizes[1:3]) ** 2
    return variance


def _residual_scale(samples: MotorSamples, residual: FloatArray, repetition: float, bins: int = 8) -> FloatArray:
    """(nj,) rms of the residual's means in bins of speed or of load, whichever is more, beyond what noise makes them [Nm]."""
    found = np.zeros(residual.shape[1])
    slowing, load = residual * np.sign(samples.sign), np.abs(samples.torque)
    for joint, used in enumerate(samples.slides.T > 0):
        for what, left in ((samples.velocity, residual), (load, slowing)):
            parts = np.array_split(left[used, joint][np.argsort(what[used, joint])], bins)
            squares = [part.mean() ** 2 - repetition * part.var() / len(part) for part in parts if len(part)]
            found[joint] = max(found[joint], sum(squares) / bins)
    return np.sqrt(found)
