"""Joint estimate of two runs of one robot: errors of both cancel in a difference between the runs, for example a payload.

The parameters are x, those of the first run, and y, from which those of the second run follow:

    x_2 = x  for constant parameters,
    x_2 = y  for parameters of one run: the base, the clock, the floor,
    x_2 = x + f y  for parameters that drift, with f the drift's std over the prior's;

and g, the common gain error of the scale. `drift` in the parameter table selects the case. Joint offsets, the IMU's mounting,
link masses and the feet are constant without disassembly; biases and friction drift with temperature.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError, SettingsError
from equipoise.estimator.equations.equation import MotionSamples
from equipoise.estimator.measurements.scale_reading import check_mass
from equipoise.estimator.parameters import Unknowns
from equipoise.estimator.problem import MapProblem, body_prior_rows, prior_rows, total_mass
from equipoise.estimator.solve import NormalEquations, solve
from equipoise.estimator.unknowns import Priors
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

_ROUNDS = 2  # of renewed noise levels


@dataclass(frozen=True)
class ScaleReadings:
    """Masses of the whole robot from a scale in the two runs.

    Attributes:
        masses: mass of the whole robot in each run [kg]; None: not weighed.
        gain: standard deviation of the scale's gain, common to both readings.
        noise: standard deviation of each reading, without the gain, over the mass.
    """

    masses: tuple[float | None, float | None] = (None, None)
    gain: float = 0.005
    noise: float = 0.001

    def __post_init__(self) -> None:
        for mass in self.masses:
            if mass is not None:
                check_mass(mass)
        for name in ("gain", "noise"):
            if not 0 < getattr(self, name) < 1:
                raise SettingsError(f"{name} of the scale is {getattr(self, name)}; it must be above 0 and below 1")


@dataclass(frozen=True, eq=False)
class TwoRuns:
    """Joint posterior of two runs.

    Attributes:
        unknowns: layout of a run's parameters.
        first, second: (size,) posterior mode of each run.
        covariance: (2 size, 2 size) covariance of both runs.
        converged: True if the last step was small.
    """

    unknowns: Unknowns
    first: FloatArray
    second: FloatArray
    covariance: FloatArray
    converged: bool


def estimate_two_runs(
    robot: RobotModel,
    stance: Stance,
    runs: tuple[Sequence[MotionSamples], Sequence[MotionSamples]],
    priors: Priors | None = None,
    scale: ScaleReadings | None = None,
) -> TwoRuns:
    """Estimate two runs of a robot that was not taken apart in between.

    Raises:
        RecordingError: a run has no lift trial that can be used.
    """
    problem = _TwoProblems(robot, stance, runs, priors or Priors(), scale or ScaleReadings())
    z, converged = solve(problem, problem.start(), _ROUNDS)
    information = problem.normal_equations(z).information
    both = np.vstack([problem.to_first, problem.to_second])
    covariance = both @ np.linalg.inv(information) @ both.T
    return TwoRuns(
        problem.unknowns, problem.to_first @ z, problem.to_second @ z, np.asarray(covariance, dtype=float), converged
    )


class _TwoProblems:
    """Least-squares problem in z = (x, y, g).

    Attributes:
        to_first, to_second: (size, len(z)) matrices from z to the parameters of each run.
    """

    def __init__(
        self, robot: RobotModel, stance: Stance, runs: tuple[Sequence[MotionSamples], Sequence[MotionSamples]], priors: Priors,
        scale: ScaleReadings,
    ) -> None:  # fmt: skip
        self.problems = [
            _named(which, robot, stance, motions, priors)
            for which, motions in zip(("first", "second"), runs, strict=True)
        ]
        self.unknowns = self.problems[0].unknowns
        self._scale = scale
        size = self.unknowns.size
        kept, drift = np.ones(size), np.zeros(size)
        kept[self.unknowns["base"]], drift[self.unknowns["base"]] = 0.0, 1.0
        for row in self.unknowns.rows:
            block = self.unknowns[row.name]
            kept[block], drift[block] = (0.0, 1.0) if row.drift is None else (1.0, row.drift)
        nothing = np.zeros((size, 1))
        self.to_first = np.hstack([np.eye(size), np.zeros((size, size)), nothing])
        self.to_second = np.hstack([np.diag(kept), np.diag(drift), nothing])

    def start(self) -> FloatArray:
        """Return the (len(z),) values of the model in both runs."""
        x = self.unknowns.start()
        y = np.zeros_like(x)
        y[self.unknowns["base"]] = x[self.unknowns["base"]]
        return np.concatenate([x, y, [0.0]])

    def prepare(self, x: FloatArray) -> None:
        for problem, run in self._runs(x):
            problem.prepare(run)

    def renew_noise(self, x: FloatArray) -> None:
        for problem, run in self._runs(x):
            problem.renew_noise(run)

    def normal_equations(self, x: FloatArray, fix_scale: bool = False) -> NormalEquations:
        equations = NormalEquations.of(*self._priors(x))
        to_runs = self.to_first, self.to_second
        for (problem, run), to_run, mass in zip(self._runs(x), to_runs, self._scale.masses, strict=True):
            own = problem.motion_equations(run)
            if fix_scale and mass is None:
                own += NormalEquations.of(*problem.scale_residual(run))
            equations += NormalEquations(to_run.T @ own.information @ to_run, to_run.T @ own.gradient, own.cost)
        return equations

    def _runs(self, z: FloatArray) -> list[tuple[MapProblem, FloatArray]]:
        return list(zip(self.problems, (self.to_first @ z, self.to_second @ z), strict=True))

    def _priors(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the residuals of the priors of x and y and of the scale, and their derivative by z."""
        unknowns, size = self.unknowns, self.unknowns.size
        first, second = self.to_first @ z, self.to_second @ z
        parts = [prior_rows(unknowns, first, None), body_prior_rows(unknowns, second, None)]
        changed = slice(size + unknowns.tabled.start, None)  # y except the base, and g
        changes = np.eye(len(z))[changed]
        rows = [parts[0][0], parts[1][0], z[changed] / np.append(np.ones(len(changes) - 1), self._scale.gain)]
        changes[-1] /= self._scale.gain
        columns = [parts[0][1] @ self.to_first, parts[1][1] @ self.to_second, changes]
        for mass, run, to_run in zip(self._scale.masses, (first, second), (self.to_first, self.to_second), strict=True):
            if mass is None:
                continue
            total, derivative = total_mass(unknowns, run)
            noise = self._scale.noise * mass
            row = (1 + z[-1]) * (derivative @ to_run)
            row[-1] = total
            rows.append(np.array([((1 + z[-1]) * total - mass) / noise]))
            columns.append(row[None] / noise)
        return np.concatenate(rows), np.concatenate(columns)


def _named(
    which: str, robot: RobotModel, stance: Stance, motions: Sequence[MotionSamples], priors: Priors
) -> MapProblem:
    try:
        return MapProblem(robot, stance, motions, priors, None)
    except RecordingError as error:
        raise RecordingError(f"the {which} run: {error}") from error
