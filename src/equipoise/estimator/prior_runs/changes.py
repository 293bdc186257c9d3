"""Estimate of a run with a prior run, and the unusual changes between the two.

N(m, S) is the prior from the prior run, W = S^-1, x the posterior mode and C its covariance. The score at the mean is
s = W (x - m); without changes its covariance is F = W - W C W. For a change d of one parameter alone

    s_j / sqrt(F_jj) ~ N(0, 1),    d = s_j / F_jj,

a score test like those of fixed parameters (diagnostics/score.py). The least likely parameter gets a prior as wide as its
change, and all are tested again, because one changed encoder raises the scores of related parameters.

Noise levels are estimated with wide priors for all parameters that may change: otherwise a change would raise the noise.
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
from equipoise.estimator.problem import MapProblem, Posterior, estimate_posterior
from equipoise.estimator.solve import descend, solve
from equipoise.estimator.unknowns import Priors, Unknown
from equipoise.result.findings import Check, SensorFinding
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

_FALSE_ALARM = 5e-2  # probability of any reported change in a run without changes
_INFORMATIVE = 0.1  # least F_jj: a change three times the prior is then one standard deviation of the noise
_MOST = 4  # more changes mean another robot, or one that was taken apart
# Joint offsets change when the robot is switched on; changes of the IMU's mounting cannot be separated from its biases.
_MAY_CHANGE = ("joint_offset",)
FREE = 4.0
"""Added variance of parameters that may have changed, in units of the prior."""


@dataclass(frozen=True)
class Change:
    """Change of one parameter since the prior run.

    Attributes:
        row: row of the parameter table.
        each: label of the parameter in its row.
        place: index of the parameter in the vector.
        value: change since the prior run, in the row's unit.
        std: posterior standard deviation of the change.
        deviate: normal deviate as unlikely as the score without a change.
    """

    row: Unknown
    each: str
    place: int
    value: float
    std: float
    deviate: float

    @property
    def name(self) -> str:
        """Name of the parameter in prose."""
        return self.row.label.format(each=self.each)

    @property
    def amount(self) -> str:
        """Value with unit and standard deviation."""
        factor, unit = (1000.0, f"m{self.row.unit}") if self.row.unit in ("rad", "m", "s") else (1.0, self.row.unit)
        return f"{factor * self.value:+.2g} {unit}".strip() + f" (std {factor * self.std:.1g})"

    @property
    def message(self) -> str:
        """Message of the finding."""
        return f"the {self.name} changed by {self.amount} since the prior run"

    def finding(self) -> SensorFinding:
        """Return the finding of the change."""
        return SensorFinding(f"{self.name}: change", self.value, self.std, self.message, True, self.row.unit)


def prior_run_check(changes: Sequence[Change], prior_run: PriorRun) -> Check:
    """Test that this is the robot of the prior run, with at most a few changes."""
    if not changes:
        return Check("prior run", True, f"sensors and legs agree with those of {prior_run.name}")
    named = "; ".join(change.message for change in changes)
    if len(changes) < _MOST:
        return Check("prior run", True, f"{named}; the estimate includes this")
    return Check(
        "prior run", False, f"{named}. The robot was taken apart since {prior_run.name}, or it is another robot: calibrate it "
        "without --prior-run",
    )  # fmt: skip


def estimate_with_prior_run(
    robot: RobotModel,
    stance: Stance,
    motions: Sequence[MotionSamples],
    priors: Priors,
    mass: tuple[float, float] | None,
    prior_run: PriorRun | None,
    lifts_needed: bool = True,
    rounds: int = 2,
) -> tuple[Posterior, tuple[Change, ...]]:
    """Estimate the posterior from all motions and a prior run, if any, and the changes since that.

    Args:
        priors: as from `PriorRun.priors_of`.
        mass: mass of the whole robot from a scale, and its standard deviation [kg].
        lifts_needed: True to require a lift; False to accept joint torques alone.
        rounds: number of times that noise levels are renewed without a prior run.

    Raises:
        RecordingError: no lift trial can be used, nor joint torques where they suffice.
        SettingsError: the prior run is of another robot.
    """
    if prior_run is None:
        return estimate_posterior(robot, stance, motions, priors, mass, rounds, lifts_needed), ()
    prior_run.check(robot)
    problem = MapProblem(robot, stance, motions, priors, mass, lifts_needed)
    unknowns = problem.unknowns
    wider = {int(place): FREE for place in unknowns.columns(*_MAY_CHANGE)}
    start = np.concatenate([prior_run.x[:10], prior_run.distribution(unknowns).mean])
    x, _ = solve(problem.with_prior(prior_run.distribution(unknowns, wider)), start, 2)
    quiet = problem.at_residual_noise(x)
    changed: dict[int, float] = {}
    changes: list[Change] = []
    while True:
        prior = prior_run.distribution(unknowns, changed, shown=True)
        tested = quiet.with_prior(prior)
        if len(changes) == _MOST or (change := _least_likely(tested, prior, descend(tested, x)[0], changed)) is None:
            break
        changes.append(change)
        changed[change.place] = max(1.0, (change.value / float(unknowns.scale[change.place])) ** 2)
    after = problem.with_prior(prior_run.distribution(unknowns, changed))
    x, converged = descend(after, x)
    return after.posterior(x, converged), tuple(changes)


def _least_likely(
    after: MapProblem, prior: PriorDistribution, x: FloatArray, changed: dict[int, float]
) -> Change | None:
    """Return the most significant change; None if none is significant."""
    unknowns = after.unknowns
    covariance = np.asarray(np.linalg.inv(after.normal_equations(x).information), dtype=float)
    rows = unknowns.tabled
    score, spread = prior.score(x[rows], covariance[rows, rows])
    score, variance = (np.concatenate([np.zeros(rows.start), part]) for part in (score, np.diag(spread)))
    tested = [int(at) for at in unknowns.columns(*_MAY_CHANGE) if at not in changed and variance[at] > _INFORMATIVE]
    if not tested:
        return None
    deviates = {place: float(score[place] / np.sqrt(variance[place])) for place in tested}
    worst = max(deviates, key=lambda place: abs(deviates[place]))
    if abs(deviates[worst]) < NormalDist().inv_cdf(1 - _FALSE_ALARM / (2 * len(tested))):
        return None
    return _change(unknowns, worst, score[worst] / variance[worst], 1 / variance[worst], deviates[worst])


def _change(unknowns: Unknowns, place: int, value: float, variance: float, deviate: float) -> Change:
    row = next(row for row in unknowns.rows if unknowns[row.name].start <= place < unknowns[row.name].stop)
    scale: float = float(unknowns.scale[place])
    each: str = unknowns.labels(row)[place - int(unknowns[row.name].start)]
    return Change(row, each, place, float(value) * scale, float(np.sqrt(variance)) * scale, abs(float(deviate)))
