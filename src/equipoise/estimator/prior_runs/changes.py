"""The estimate of a run of which an earlier one is known, and what changed between the two beyond what is usual.

With N(m, S) what the earlier run makes of the unknowns, W = S^-1, x the posterior's mode and C its covariance, the evidence
pulls at the mean with s = W (x - m). Where nothing changed it does so with the covariance F = W - W C W, so that for a change
d of one unknown alone

    s_j / sqrt(F_jj) ~ N(0, 1),    d = s_j / F_jj,

a score test as those of what is held (diagnostics/score.py). What is least likely begins anew, with as wide a prior as that
change, and all are tested again: one encoder that moved pulls at all that it touches.

Noise levels are found while whatever may have moved is free: else a zero that moved would pass for noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.equations.equation import MotionSamples
from equipoise.estimator.parameters import PriorDistribution, Unknowns
from equipoise.estimator.prior_runs.prior_run import PriorRun
from equipoise.estimator.problem import MapProblem, Posterior
from equipoise.estimator.solve import descend, solve
from equipoise.estimator.unknown import Unknown
from equipoise.estimator.unknowns import Priors
from equipoise.result.findings import Check, SensorFinding
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

# Chance that anything is said to have changed in a run where nothing has.
_UNLIKELY = 5e-2
_SEEN = 0.1  # of F: a change three times the prior is one standard deviation of the noise
_MOST = 4  # more that changed are another robot, or one that was taken apart
_MAY_MOVE = (
    "joint_offset",
)  # read anew when the robot is switched on; the IMU's mounting cannot be told from its biases
FREE = 4.0
"""Variance in units of the prior, of what may have moved."""


@dataclass(frozen=True)
class Change:
    """What is other than in the earlier run.

    Attributes:
        row: row of the table of unknowns.
        each: label of the unknown among those of the row.
        place: place of the unknown in the vector of unknowns.
        value: change since the earlier run, in the row's unit.
        std: posterior standard deviation of the change.
        deviate: normal deviates by which it is unlikely that nothing changed.
    """

    row: Unknown
    each: str
    place: int
    value: float
    std: float
    deviate: float

    @property
    def name(self) -> str:
        """What changed."""
        return self.row.label.format(each=self.each)

    @property
    def amount(self) -> str:
        """How far, in words."""
        factor, unit = (1000.0, f"m{self.row.unit}") if self.row.unit in ("rad", "m", "s") else (1.0, self.row.unit)
        return f"{factor * self.value:+.2g} {unit}".strip() + f" (sd {factor * self.std:.1g})"

    @property
    def message(self) -> str:
        """All of it."""
        return f"the {self.name} moved by {self.amount} since the earlier run"

    def finding(self) -> SensorFinding:
        """What is reported of it."""
        return SensorFinding(f"{self.name}: change", self.value, self.std, self.message, True, self.row.unit)


def check_of_changes(changes: Sequence[Change], known: PriorRun) -> Check:
    """Whether this is the robot of the earlier run, but for what can be named."""
    if not changes:
        return Check("prior run", True, f"nothing speaks against sensors and legs being those of {known.name}")
    named = "; ".join(change.message for change in changes)
    if len(changes) < _MOST:
        return Check("prior run", True, f"{named}: estimated anew")
    return Check(
        "prior run", False, f"{named}. So much does not change by itself: was the robot taken apart, or is it another "
        f"one than that of {known.name}? Calibrate it anew, without --prior-run",
    )  # fmt: skip


def estimate_after(
    robot: RobotModel,
    stance: Stance,
    motions: Sequence[MotionSamples],
    priors: Priors,
    mass: tuple[float, float] | None,
    known: PriorRun,
    lifts_needed: bool = True,
) -> tuple[Posterior, tuple[Change, ...]]:
    """The most probable unknowns given all motions and an earlier run, and what changed since that.

    Args:
        priors: as of `PriorRun.priors_of`.
        mass: mass of the whole robot from a scale, and its standard deviation [kg].
        lifts_needed: whether motions without any lift are refused, or are estimated from as far as joint torques go.

    Raises:
        RecordingError: no lift trial can be used; or there are no joint torques either.
        SettingsError: the earlier run is of another robot.
    """
    known.check(robot)
    problem = MapProblem(robot, stance, motions, priors, mass, lifts_needed)
    unknowns = problem.unknowns
    loose = {int(place): FREE for place in unknowns.columns(*_MAY_MOVE)}
    x, _ = solve(problem.believing(known.belief(unknowns, loose)), _start(known, unknowns), 2)
    looked_at = problem.at_residual_noise(x)
    anew: dict[int, float] = {}
    changes: list[Change] = []
    while True:
        shown = known.belief(unknowns, anew, shown=True)
        at_shown = looked_at.believing(shown)
        if len(changes) == _MOST or (change := _least_likely(at_shown, shown, descend(at_shown, x)[0], anew)) is None:
            break
        changes.append(change)
        anew[change.place] = max(1.0, (change.value / float(unknowns.scale[change.place])) ** 2)
    after = problem.believing(known.belief(unknowns, anew))
    x, converged = descend(after, x)
    return after.posterior(x, converged), tuple(changes)


def _start(known: PriorRun, unknowns: Unknowns) -> FloatArray:
    """(size,) the earlier run's own values."""
    x = np.concatenate([known.x[:10], known.belief(unknowns).mean])
    return np.asarray(x, dtype=float)


def _least_likely(after: MapProblem, belief: PriorDistribution, x: FloatArray, anew: dict[int, float]) -> Change | None:
    """The change that the evidence asks for most, if it is unlikely that nothing changed."""
    unknowns = after.unknowns
    covariance = np.linalg.inv(after.normal_equations(x).information)
    score, seen = _scores(unknowns, belief, x, np.asarray(covariance, dtype=float))
    tested = [int(place) for place in unknowns.columns(*_MAY_MOVE) if place not in anew and seen[place] > _SEEN]
    if not tested:
        return None
    deviates = {place: float(score[place] / np.sqrt(seen[place])) for place in tested}
    worst = max(deviates, key=lambda place: abs(deviates[place]))
    if abs(deviates[worst]) < NormalDist().inv_cdf(1 - _UNLIKELY / (2 * len(tested))):
        return None
    return _change(unknowns, worst, -score[worst] / seen[worst], 1 / seen[worst], deviates[worst])


def _scores(
    unknowns: Unknowns, belief: PriorDistribution, x: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(size,) pull at each unknown's mean, and its variance where nothing changed; zero for the base."""
    rows, information = unknowns.tabled, belief.information
    score, seen = np.zeros(unknowns.size), np.zeros(unknowns.size)
    score[rows] = -information @ (x[rows] - belief.mean)
    seen[rows] = np.diag(information - information @ covariance[rows, rows] @ information)
    return score, seen


def _change(unknowns: Unknowns, place: int, value: float, variance: float, deviate: float) -> Change:
    row = next(row for row in unknowns.rows if unknowns[row.name].start <= place < unknowns[row.name].stop)
    scale: float = float(unknowns.scale[place])
    each: str = unknowns.labels(row)[place - int(unknowns[row.name].start)]
    return Change(row, each, place, float(value) * scale, float(np.sqrt(variance)) * scale, abs(float(deviate)))
