"""Causes of a lean: joint offsets, IMU level, payload and torque gains, compared by their effect on a standing robot.

The effect of a cause is the shift of the CoM over the feet at the nominal stance, in base axes:

- A joint offset moves its foot by -J offset. The base turns and moves until all feet fit their places best (least squares).
- A robot that keeps its IMU level turns by the IMU's level error: its tilt, and the accelerometer's bias over gravity.
- A payload shifts the CoM from its place in the model file.
- A torque gain changes the force on its foot by -J^-T (gain x torque), which moves the centre of pressure. It acts where a
  controller feeds torques forward.

The priors of joint offsets and torque gains describe sound robots, and a faulty joint's estimate shrinks towards them. So the
joint offset or torque gain that conflicts most with its prior gets a jump, as long as the jump's Bayes factor exceeds their
number.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import NotEstimatedError
from equipoise.estimator.diagnostics.score import deviate
from equipoise.estimator.measurements.leg_motion import cross_matrix
from equipoise.estimator.posterior_evidence import PosteriorEvidence
from equipoise.estimator.problem import Posterior, body_jacobian
from equipoise.result.calibration import Calibration
from equipoise.result.quantity import Quantity
from equipoise.result.statistics import PLANAR_95
from equipoise.robot.kinematics import Kinematics, massless_leg_forces
from equipoise.robot.statics import static_torques

_JUMP = 6.0  # prior stds of a jump: 30 mrad of a joint offset, 18 % of a torque gain
_FALSE_ALARM = 5e-3  # probability that any cause of a kind is significant on a robot without errors
_VISIBLE = 5e-3  # [rad]: CoM shift over hip height; causes that are certainly smaller are ruled out
_INSEPARABLE = 0.7  # correlation
_INFORMATIVE = 1e-6  # least variance of a shift's direction, over the largest
_CHANGES = {
    "joint_offset": "set {part} to {value:.4f} in joint_offsets.yaml (equipoise export RUN --to joint-offsets --force)",
    "imu_level": "set imu_tilt and accelerometer_bias of the IMU (equipoise export RUN --to toml --force)",
    "payload": "set the inertial of link {base!r} in the model file (equipoise export RUN --to urdf)",
    "torque_gain": "set relative_gain of {part} to {value:.3f}; measure it: equipoise calibrate --parameters motors",
}
"""Entry to change, by kind of cause."""


@dataclass(frozen=True, eq=False)
class Cause:
    """Possible cause of a lean.

    Attributes:
        name: name of the cause, as "FL_calf_joint offset".
        kind: "joint_offset", "imu_level", "payload" or "torque_gain".
        values: estimates of the error, with standard deviations.
        shift: (2,) shift of the CoM over the feet, forward and to the left [m].
        bound: half axis of the shift's 95 % ellipse in its longest direction [m].
        lean: (2,) roll and pitch of the base [rad]; None: they depend on the controller's stiffness.
        deviate: normal deviate as unlikely as the shift if there is no error.
        verdict: "significant"; "possible"; or "ruled out", if even the largest shift in the ellipse is not visible.
        change: the file entry to change, and the command that writes it.
    """

    name: str
    kind: str
    values: tuple[Quantity, ...]
    shift: FloatArray
    bound: float
    lean: FloatArray | None
    deviate: float
    verdict: str
    change: str

    @property
    def size(self) -> float:
        """Length of the shift [m]."""
        return float(np.linalg.norm(self.shift))


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Causes of a lean, ranked.

    Attributes:
        robot: name of the robot.
        causes: causes by verdict, then by decreasing deviate.
        inseparable: names of a significant cause (or the first one) and of another, whose estimates are correlated, and the
            correlation.
    """

    robot: str
    causes: tuple[Cause, ...]
    inseparable: tuple[tuple[str, str, float], ...]


class _Effect(NamedTuple):
    """Error of one part.

    Attributes:
        kind, name: as of a `Cause`.
        units: unit of each of its k values, by name.
        rows: (k, size) derivative of the values by the parameters.
        outcome: (2 or 4, k) derivative of the shift [m] and, with four rows, of the lean [rad] by the values.
        before: (k,) values without jumps.
    """

    kind: str
    name: str
    units: dict[str, str]
    rows: FloatArray
    outcome: FloatArray
    before: FloatArray


def diagnose(result: Calibration) -> Diagnosis:
    """Return the causes of a lean, ranked.

    Args:
        result: result of the Bayesian method with its evidence.

    Raises:
        NotEstimatedError: the result has no posterior: it is of another method, or was read from a file.
    """
    if not isinstance(result.evidence, PosteriorEvidence):
        raise NotEstimatedError(
            f"this result of the method {result.method!r} has no posterior of sensor errors; diagnose the run folder of a "
            "calibration with --method bayesian, or a log"
        )
    posterior = result.evidence.posterior
    x, covariance = _with_jumps(posterior)
    change = np.array([quantity.change for quantity in result.composite])
    effects = [
        effect for effect in _effects(posterior, change) if effect.rows.any()
    ]  # others are fixed by their priors
    counts = Counter(effect.kind for effect in effects)
    causes = [_cause(effect, posterior, x, covariance, counts[effect.kind]) for effect in effects]
    order = ("significant", "possible", "ruled out")
    ranked = sorted(causes, key=lambda cause: (order.index(cause.verdict), -cause.deviate))
    named = [cause for cause in ranked if cause.verdict == "significant"] or ranked[:1]
    parts = {effect.name: effect for effect in effects}
    inseparable = [
        (one.name, other.name, correlation)
        for one in named
        for other in ranked
        if other is not one
        and (correlation := _correlation(posterior, parts[one.name], parts[other.name])) > _INSEPARABLE
    ]
    return Diagnosis(result.robot, tuple(ranked), tuple(inseparable))


def _cause(effect: _Effect, posterior: Posterior, x: FloatArray, covariance: FloatArray, alike: int) -> Cause:
    """Return a cause from its effect.

    Args:
        x, covariance: parameters with jumps.
        alike: number of causes of this kind.
    """
    values = effect.before + effect.rows @ (x - posterior.x)
    spread = effect.rows @ covariance @ effect.rows.T
    quantities = tuple(
        Quantity(name, unit, float(value), math.sqrt(variance))
        for (name, unit), value, variance in zip(effect.units.items(), values, np.diag(spread), strict=True)
    )
    outcome, of_shift = effect.outcome @ values, effect.outcome[:2] @ spread @ effect.outcome[:2].T
    shift, largest = outcome[:2], float(np.linalg.eigvalsh(of_shift)[-1])
    unlikely = deviate(of_shift / largest, shift / math.sqrt(largest), _INFORMATIVE)
    bound = PLANAR_95 * math.sqrt(largest)
    limit = NormalDist().inv_cdf(1 - _FALSE_ALARM / alike)
    visible = float(np.linalg.norm(shift)) + bound > _VISIBLE * posterior.unknowns.stance.hip_height
    verdict = "significant" if unlikely > limit else "possible" if visible else "ruled out"
    lean = outcome[2:] if len(outcome) > 2 else None
    part, base = effect.name.partition(" ")[0], posterior.unknowns.robot.base_link
    change = _CHANGES[effect.kind].format(part=part, value=values[0], base=base)
    return Cause(effect.name, effect.kind, quantities, shift, bound, lean, unlikely, verdict, change)


def _with_jumps(posterior: Posterior) -> tuple[FloatArray, FloatArray]:
    """Return x and its covariance with a jump of each joint offset and torque gain that conflicts with its prior.

    With prior information P and posterior covariance C, data alone have the information I = e' (P - P C P) e about a jump
    along e, and the score s = e' P (x - mean). A jump of prior variance a^2 changes x by C P e s / (I + a^-2); its Bayes
    factor is exp(s^2 / (I + a^-2) / 2) / sqrt(1 + a^2 I).
    """
    unknowns, x, covariance = posterior.unknowns, posterior.x, posterior.covariance
    tabled, prior = unknowns.tabled, unknowns.tabled_prior
    joints = unknowns.columns("joint_offset", "torque_gain") - tabled.start
    for _ in joints:
        scores, spread = prior.score(x[tabled], covariance[tabled, tabled])
        scores, information = scores[joints], np.diag(spread)[joints] + _JUMP**-2
        factors = scores**2 / information / 2 - np.log(_JUMP**2 * information) / 2
        best = int(np.argmax(factors))
        if factors[best] < math.log(len(joints)):
            break
        along = prior.information[:, joints[best]]
        moved = covariance[:, tabled] @ along
        x = np.asarray(x + moved * scores[best] / information[best], dtype=float)
        covariance = np.asarray(covariance + np.outer(moved, moved) / information[best], dtype=float)
        prior = prior.with_added_variance(joints[best], _JUMP**2)
    return x, covariance


def _correlation(posterior: Posterior, one: _Effect, other: _Effect) -> float:
    """Return the largest correlation between values of two causes, both with jumps: their priors would separate them."""
    tabled, prior = posterior.unknowns.tabled, posterior.unknowns.tabled_prior
    rows = np.concatenate([one.rows, other.rows])
    errors = np.concatenate([effect.rows[:, tabled] for effect in (one, other) if effect.kind != "payload"])
    along = prior.information[:, np.flatnonzero(errors.any(axis=0))]
    information = along.T @ (prior.covariance - posterior.covariance[tabled, tabled]) @ along
    moved = rows @ posterior.covariance[:, tabled] @ along
    spread = rows @ posterior.covariance @ rows.T
    spread += moved @ np.linalg.solve(information + _JUMP**-2 * np.eye(len(information)), moved.T)
    count = len(one.rows)
    roots = [np.linalg.inv(np.linalg.cholesky(part)) for part in (spread[:count, :count], spread[count:, count:])]
    return float(np.linalg.svd(roots[0] @ spread[:count, count:] @ roots[1].T, compute_uv=False)[0])


def _effects(posterior: Posterior, change: FloatArray) -> Iterator[_Effect]:
    """Yield the effects of all errors on a robot at its nominal stance.

    Args:
        change: (10,) estimate of the whole robot minus the model file.
    """
    unknowns = posterior.unknowns
    robot, q, joints = unknowns.robot, unknowns.stance.joint_position, unknowns.robot.leg_joints
    kinematics = Kinematics(robot)
    feet, jacobians = kinematics.feet_and_jacobians(q)
    middle, gravity = feet.mean(axis=0), float(np.linalg.norm(robot.pinocchio.gravity.linear))
    # Shift of the CoM by a rotation about the middle of the feet; rotation and translation of the base that fit moved feet.
    turned = cross_matrix(middle - kinematics.com(q))[:2]
    fit = np.linalg.pinv(np.concatenate([np.hstack([cross_matrix(middle - foot), np.eye(3)]) for foot in feet]))
    torques = static_torques(robot, q, robot.legs)[joints]

    def rows(name: str, factor: FloatArray) -> FloatArray:
        whole = np.zeros((len(factor), unknowns.size))
        whole[:, unknowns[name]] = (
            factor[:, : unknowns[name].stop - unknowns[name].start] * unknowns.scale[unknowns[name]]
        )
        return whole

    def effect(kind: str, name: str, units: dict[str, str], own: FloatArray, outcome: FloatArray) -> _Effect:
        return _Effect(kind, name, units, own, outcome, own @ posterior.x)

    for leg, joint in np.ndindex(*joints.shape):
        label, one = robot.joint_names[joints[leg, joint]], np.eye(len(robot.joint_names))[[joints[leg, joint]]]
        moved, extra = np.zeros((4, 3)), np.zeros_like(torques)
        moved[leg], extra[leg, joint] = jacobians[leg, :, joint], torques[leg, joint]
        turn = fit @ moved.ravel()
        outcome = np.concatenate([turned @ turn[:3] + turn[3:5], turn[:2]])[:, None]
        yield effect("joint_offset", f"{label} offset", {"offset": "rad"}, rows("joint_offset", one), outcome)
        # The moment of the forces about the middle of the feet is that of a CoM that is shifted.
        moment = np.cross(feet - middle, massless_leg_forces(jacobians, extra)).sum(axis=0)
        pressed = np.array([[moment[1]], [-moment[0]]]) / (robot.mass * gravity)
        yield effect("torque_gain", f"{label} torque gain", {"gain": "1"}, rows("torque_gain", one), pressed)
    level = np.array(robot.imu_in_base.rotation)[:2]
    bias = -level @ cross_matrix(np.array(robot.imu_in_base.rotation)[2]) / gravity
    own = rows("imu_tilt", level) + rows("accelerometer_bias", bias)
    outcome = np.concatenate([-turned[:, :2], -np.eye(2)])
    yield effect("imu_level", "IMU level", {"roll": "rad", "pitch": "rad"}, own, outcome)
    units = {"mass": "kg", "com_x": "m", "com_y": "m"}
    body = body_jacobian(unknowns, posterior.x, unknowns.robot_body)[:3]
    yield _Effect("payload", "payload", units, body, np.eye(3)[1:], change[:3])
