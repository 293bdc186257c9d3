"""Predicted intervals with a scale or with more robot time, and the first motions of such a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from equipoise.bayesian.method import BayesianMethod
from equipoise.bayesian.plan import Plan, Visit, make_plan
from equipoise.bayesian.planning.candidates import Candidates, describe
from equipoise.bayesian.routine import plan_ahead
from equipoise.conventions import FloatArray
from equipoise.errors import EquipoiseError
from equipoise.estimator.posterior_evidence import PosteriorEvidence
from equipoise.estimator.problem import Posterior, body_jacobian, total_mass
from equipoise.figures.blocks import Block, DataTable, number
from equipoise.report.part_figures import motors_alone
from equipoise.result.calibration import Calibration
from equipoise.result.shown import ROWS, called
from equipoise.result.statistics import NORMAL_95
from equipoise.robot.inertial import COMPONENTS
from equipoise.robot.model import DIAGONALS, RobotModel
from equipoise.robot.stance import nominal_stance

_SCALE = 0.005  # std of an ordinary scale, as a fraction of the mass
_MORE = 60.0  # [s] of robot time on an A1
_SHOWN_MOTIONS = 4
_WEAKEST = 3  # number of parameters to name


@dataclass(frozen=True, eq=False)
class Outlook:
    """Present and predicted uncertainty of the whole robot's parameters.

    Attributes:
        intervals: (10,) half widths of the 95 % intervals, SI units, by action; "now": present values.
        motions: descriptions of the first motions of a longer run.
        weakest: names of the parameters furthest above their target uncertainty, worst first.
    """

    intervals: dict[str, FloatArray]
    motions: list[str]
    weakest: list[str]


def advice_blocks(result: Calibration) -> list[Block]:
    """Return the predicted effect of more data; for methods other than `bayesian`, of a run with `bayesian`."""
    robot = result.robot_model
    if robot is None:
        return []
    if motors_alone(result):
        return ["To estimate mass, centre of mass and inertia in the same run, pass `--parameters base,motors`."]
    posterior = result.evidence.posterior if isinstance(result.evidence, PosteriorEvidence) else None
    try:
        return _ahead(robot) if posterior is None else _further(outlook(result, robot, posterior), result)
    except EquipoiseError as error:
        return [f"The effect of more motions cannot be predicted: {error}"]


def outlook(result: Calibration, robot: RobotModel, posterior: Posterior) -> Outlook:
    """Return the intervals, and those predicted with more robot time (a minute on an A1), with a scale, and with both.

    Raises:
        EquipoiseError: no motions can be planned for the robot.
    """
    unknowns = posterior.unknowns
    stance = nominal_stance(robot)
    to_body = body_jacobian(unknowns, posterior.x, unknowns.robot_body)
    information = np.asarray(np.linalg.inv(posterior.covariance), dtype=float)
    found = robot.with_base(posterior.base_body.to_pinocchio())
    candidates = Candidates.of(found, stance, posterior.robot_body.com, unknowns.priors)
    time = _MORE * stance.scale.time
    more = make_plan(candidates, time, known=information, searched=True)
    scale = _scale_information(posterior, robot)
    both = make_plan(candidates, time, known=information + scale, searched=True)
    now = np.sqrt(np.diag(posterior.robot_covariance))
    with_scale = np.sqrt(np.diag(to_body @ np.linalg.inv(information + scale) @ to_body.T))
    weighed = result.settings["mass"] is not None
    intervals = {"now": now, **({} if weighed else {"with a scale": np.minimum(with_scale, now)})}
    intervals[f"{time:.0f} s more"] = np.minimum(more.std, now)
    if not weighed:
        intervals["both"] = np.minimum(both.std, np.minimum(with_scale, now))
    goals = BayesianMethod().goals.vector(np.abs(more.body), stance)
    over = {name: float(ratio) for name, ratio in zip(COMPONENTS, now / goals, strict=True) if ratio > 1}
    weakest = sorted(over, key=lambda name: -over[name])[:_WEAKEST]
    return Outlook({name: NORMAL_95 * std for name, std in intervals.items()}, _in_words(more), weakest)


def _scale_information(posterior: Posterior, robot: RobotModel) -> FloatArray:
    """Return the information matrix of a scale with a standard deviation of 0.5 % of the mass."""
    unknowns = posterior.unknowns
    _, row = total_mass(unknowns, posterior.x)
    row = row / (_SCALE * posterior.robot_body.mass)
    return np.asarray(np.outer(row, row), dtype=float)


def _in_words(plan: Plan) -> list[str]:
    """Return descriptions of the first postures of a plan, with their lifts."""
    return [
        f"posture {describe(visit.posture)}: {_lifts(visit) or 'stance motion'}"
        for visit in plan.visits[:_SHOWN_MOTIONS]
    ]


def _lifts(visit: Visit) -> str:
    lifts: list[str] = []
    for diagonal in DIAGONALS:
        if turns := visit.lifts_on(diagonal):
            lifts.append(f"lifts on {diagonal}: {turns}")
    return "; ".join(lifts)


def _further(seen: Outlook, result: Calibration) -> list[Block]:
    poor = [quantity.name for quantity in result.composite if quantity.verdict != "identified"]
    summary = (
        f"Weak, doubtful or not identified: {', '.join(map(called, poor))}."
        if poor
        else "Every parameter is identified."
        + (
            f" Largest uncertainty relative to its target: {', '.join(map(called, seen.weakest))}."
            if seen.weakest
            else " All uncertainties are within their targets."
        )
    )
    best = _best_step(seen, poor or seen.weakest)
    columns = ["parameter", *(f"|{name}, +-" for name in seen.intervals)]
    rows = [
        [label, *(number(width[index], factor, f"{form[:1]}{int(form[1]) + 1}f") for width in seen.intervals.values())]
        for index, (_, label, factor, form) in enumerate(ROWS)
    ]
    table = DataTable("Half widths of the 95 % intervals, predicted for typical sensors", columns, rows)
    more = [
        f"First motions of the run with {name}, most informative first:"
        for name in seen.intervals
        if name.endswith("more")
    ]
    return [f"{summary} {best}", table, *more[:1], *([tuple(seen.motions)] if more else [])]


def _best_step(seen: Outlook, names: list[str]) -> str:
    """Return advice on the single action that narrows the named intervals most."""
    if not names:
        return ""
    chosen = [COMPONENTS.index(name) for name in names]
    ratios = {
        name: float(np.mean(width[chosen] / seen.intervals["now"][chosen]))
        for name, width in seen.intervals.items()
        if name not in ("now", "both")
    }
    name = min(ratios, key=lambda one: ratios[one])
    action = {"with a scale": "Weigh the robot and pass `--mass`"}.get(
        name, f"Increase `--duration` by {name.removesuffix(' more')}"
    )
    if ratios[name] > 0.95:
        return "None of these alone narrows the intervals by 5 % or more on average."
    return f"{action}: this is predicted to reduce these intervals to {ratios[name]:.0%} of their width on average."


def _ahead(robot: RobotModel) -> list[Block]:
    """Return the predicted intervals of the Bayesian method."""
    plan = plan_ahead(robot, nominal_stance(robot), BayesianMethod())
    rows = [
        [label, number(NORMAL_95 * std, factor, form)]
        for (_, label, factor, form), std in zip(ROWS, plan.std, strict=True)
    ]
    message = (
        f"This method gives no intervals and estimates only some parameters. `--method bayesian` estimates all of them in "
        f"{plan.robot_time:.0f} s of robot time, with {plan.lifts} lifts in {len(plan.visits)} postures:"
    )
    return [message, DataTable("Prediction for typical sensors and a scale", ["parameter", "|95 % +-"], rows)]
