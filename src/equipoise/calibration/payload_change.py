"""Payload added to a robot or removed between two calibrations, in which errors of sensors and scale cancel.

Both runs are estimated together (estimator/prior_runs/two_runs.py). Mass, first moment and inertia about the base's
origin of rigidly joined bodies add up. The payload's are therefore those of the second base minus those of the first.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.diagnostics.screening import screen
from equipoise.estimator.motions import read_motions
from equipoise.estimator.parameters import base_vector
from equipoise.estimator.posterior_evidence import PosteriorEvidence
from equipoise.estimator.prior_runs.both_runs import both_runs
from equipoise.estimator.prior_runs.prior_run import PriorRun
from equipoise.estimator.prior_runs.two_runs import ScaleReadings, TwoRuns, estimate_two_runs
from equipoise.estimator.unknowns import Priors
from equipoise.json_form import to_json
from equipoise.recording.recording import Recording
from equipoise.result.body import Body
from equipoise.result.statistics import NORMAL_95
from equipoise.robot.inertial import InertialParameters, RobotInertia, components, composite_parameters
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance

Propagated = tuple[FloatArray, FloatArray]
"""Value of a function, and its covariance from that of the argument."""

SCHEMA = "equipoise.payload_change/1"
# Changes that are negligible for a controller: of the robot's mass, of a metre on an A1, of the largest moment.
_NEGLIGIBLE = np.array([0.01, 2e-3, 0.05])


@dataclass(frozen=True, eq=False)
class PayloadChange:
    """Difference between two runs of one robot.

    Attributes:
        robot: name of the robot.
        payload: mass, CoM in the base frame and inertia about its own CoM of the added (or `removed`) payload. CoM and
            inertia are not estimated if the mass may be zero. Verdicts compare the std of a mass with the mass, of a CoM
            with the robot's size, of an inertia with the payload's largest moment.
        change: differences of the whole robot's ten quantities at its stance, second run minus first. The verdict
            "no change" means that a significant change is excluded.
        removed: True if the robot became lighter.
        warnings: warnings about the result.
        provenance: version, time, runs, scale readings.
    """

    robot: str
    payload: Body
    change: Body
    removed: bool
    warnings: tuple[str, ...] = ()
    provenance: Mapping[str, Any] = field(default_factory=dict[str, Any])

    def with_truth(self, before: RobotInertia, after: RobotInertia) -> PayloadChange:
        """Return the difference with the ground truth of both simulated runs."""
        added = after.base.vector - before.base.vector
        truth = InertialParameters.from_vector(-added if self.removed else added) if added[0] else None
        return replace(self, payload=self.payload.with_truth(truth))

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "schema": SCHEMA,
            "robot": self.robot,
            "removed": self.removed,
            "payload": self.payload.numbers(),
            "intervals": self.payload.intervals(),
            "change": {quantity.name: quantity.value for quantity in self.change},
            "change_intervals": self.change.intervals(),
            "warnings": list(self.warnings),
            "truth": to_json(self.payload.truth),
            "provenance": dict(self.provenance),
        }


def find_payload_change(
    robot: RobotModel,
    before: Sequence[Recording],
    after: Sequence[Recording],
    scale: ScaleReadings | None = None,
    priors: Priors | None = None,
) -> PayloadChange:
    """Estimate the payload added between two runs of the method `bayesian`.

    Args:
        before, after: recordings of each run.
        scale: scale readings in each run.
        priors: prior standard deviations of the parameters.

    Raises:
        RecordingError: a run has no usable recording.
    """
    stance = nominal_stance(robot)
    for recordings in (before, after):
        screen(robot, recordings)
    motions = read_motions(robot, stance, before), read_motions(robot, stance, after)
    runs = estimate_two_runs(robot, stance, motions, priors, scale)
    warnings = () if runs.converged else ("the estimate did not converge: some recordings contradict the model",)
    return _payload_change(robot, runs, warnings)


def find_payload_change_since(robot: RobotModel, prior_run: PriorRun, evidence: PosteriorEvidence) -> PayloadChange:
    """Estimate the payload added since a prior run, from a run that uses it.

    Args:
        evidence: evidence of the result of such a run.

    Raises:
        SettingsError: the prior run is of another robot.
    """
    prior_run.check(robot)
    runs = both_runs(prior_run, evidence.posterior, evidence.changes)
    return _payload_change(robot, runs, tuple(change.message for change in evidence.changes))


def find_payload_change_from_file(robot: RobotModel, evidence: PosteriorEvidence) -> PayloadChange:
    """Estimate the payload as the whole robot minus that of the model file, whose errors therefore count as payload.

    Args:
        evidence: evidence of a result without a prior run.
    """
    posterior, file = evidence.posterior, composite_parameters(robot, nominal_stance(robot).joint_position)
    body = posterior.unknowns.robot_body
    changed = _propagated(lambda x: components(body(x)) - components(file), posterior.x, posterior.covariance)
    added = _propagated(lambda x: body(x).vector - file.vector, posterior.x, posterior.covariance)
    return _change_of(robot, changed, added, ())


def negligible_changes(whole: InertialParameters, length_scale: float) -> FloatArray:
    """Return (10,) largest changes of a robot that are negligible for a controller, in the order of COMPONENTS, SI units.

    Args:
        whole: composite of the robot.
        length_scale: length of the robot over that of an A1.
    """
    return np.repeat(_NEGLIGIBLE * [whole.mass, length_scale, whole.principal_moments[-1]], [1, 3, 6])


def _payload_change(robot: RobotModel, runs: TwoRuns, warnings: tuple[str, ...]) -> PayloadChange:
    base, body = runs.unknowns["base"], runs.unknowns.robot_body

    def added(x: FloatArray) -> FloatArray:
        first, second = np.split(x, 2)
        return base_vector(second[base]) - base_vector(first[base])

    def changed(x: FloatArray) -> FloatArray:
        first, second = np.split(x, 2)
        return components(body(second)) - components(body(first))

    both = np.concatenate([runs.first, runs.second])
    change, payload = (_propagated(function, both, runs.covariance) for function in (changed, added))
    return _change_of(robot, change, payload, warnings)


def _change_of(robot: RobotModel, changed: Propagated, added: Propagated, warnings: tuple[str, ...]) -> PayloadChange:
    """Return a change.

    Args:
        changed: (10,) changes of the whole robot in the order of COMPONENTS, and their covariance.
        added: (10,) added parameters about the base's origin, and their covariance.
    """
    (change, change_covariance), (vector, covariance) = changed, added
    stance = nominal_stance(robot)
    removed = bool(vector[0] < 0)
    vector = -vector if removed else vector
    payload = _payload(vector, covariance, float(np.ptp(stance.feet_in_base[:, 0])) / 2)
    whole = composite_parameters(robot, stance.joint_position)
    negligible = negligible_changes(whole, stance.scale.length)
    if payload.com_in_base.x.value is None:
        payload = payload.with_sure_zeros(negligible)
    difference = Body.of(change, change_covariance, np.abs(change)).with_sure_zeros(negligible)
    return PayloadChange(robot.name, payload, difference, removed, warnings)


def _payload(vector: FloatArray, covariance: FloatArray, length: float) -> Body:
    """Return a body from (10,) parameters about the base's origin; only its mass if that may be zero.

    Args:
        length: reference length for the verdict of a position [m].
    """
    if vector[0] <= NORMAL_95 * np.sqrt(covariance[0, 0]):
        mass_only, variance = np.full(10, np.nan), np.full((10, 10), np.nan)
        mass_only[0], variance[0, 0] = vector[0], covariance[0, 0]
        return Body.of(mass_only, variance, np.abs(mass_only))
    values, spread = _propagated(lambda at: components(InertialParameters.from_vector(at)), vector, covariance)
    largest = float(np.abs(values[4:]).max())
    typical = np.concatenate([values[:1], np.full(3, length), np.full(6, largest)])
    return Body.of(values, spread, typical)


def _propagated(function: Callable[[FloatArray], FloatArray], at: FloatArray, covariance: FloatArray) -> Propagated:
    """Return a function's value and its first-order covariance from those of its argument."""
    steps = 1e-3 * np.sqrt(np.diag(covariance))
    columns = [
        (function(at + step) - function(at - step)) / (2 * step[index]) if step[index] else np.zeros(10)
        for index, step in enumerate(np.diag(steps))
    ]
    jacobian = np.stack(columns, axis=1)
    return function(at), np.asarray(jacobian @ covariance @ jacobian.T, dtype=float)
