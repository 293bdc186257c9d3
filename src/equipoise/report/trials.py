"""The trials: tilts over time, how the search closed in, and a table of all motions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import accumulate

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import EquipoiseError
from equipoise.experiments.tilt import tilt_curve
from equipoise.paper.bracket import Bracket, TriedOffset, step
from equipoise.paper.iterations import com_by_iteration, tried_offsets
from equipoise.paper.trial_runner import ComSearchSettings
from equipoise.recording.recording import Recording
from equipoise.recording.trials import MEANWHILE, CommandedLift, DesignedLift, LiftTrial
from equipoise.report.blocks import SERIES, Block, axes, figure, line, short, table
from equipoise.report.numbers import tell
from equipoise.result.calibration import Calibration, Trial
from equipoise.robot.model import DIAGONALS, RobotModel
from equipoise.robot.stance import nominal_stance

_POINTS = 40  # of a curve
_VERDICTS = ("forward", "backward", "balanced")
_SYMBOLS = {"forward": "triangle-up", "backward": "triangle-down", "balanced": "circle"}


def tilt_figures(result: Calibration) -> Block | None:
    """Tilt over time of every lift, a figure for each diagonal."""
    evidence, robot = result.evidence, result.robot_model
    if evidence is None or robot is None:
        return None
    lifts = [
        (trial, recording)
        for recording in evidence.recordings
        if isinstance(trial := recording.trial, LiftTrial) and recording.complete
    ]
    told = [trial for trial in result.trials if trial.kind == "lift" and trial.verdict is not None]
    verdicts = [trial.verdict for trial in told] if len(told) == len(lifts) else [None] * len(lifts)
    figures = [
        _tilts(robot, diagonal, [(*lift, verdict) for lift, verdict in zip(lifts, verdicts, strict=True)])
        for diagonal in DIAGONALS
    ]
    there = [one for one in figures if one is not None]
    return {"type": "figures", "figures": there} if there else None


def _tilts(robot: RobotModel, diagonal: str, lifts: list[tuple[LiftTrial, Recording, str | None]]) -> Block | None:
    data: list[Block] = []
    for number, (trial, recording, verdict) in enumerate(lifts, start=1):
        if trial.diagonal != diagonal:
            continue
        kind = verdict or (trial.meanwhile if isinstance(trial, DesignedLift) else "passive")
        kinds = _VERDICTS if kind in _VERDICTS else MEANWHILE
        try:
            time, angle = tilt_curve(robot, recording, diagonal, _POINTS)
        except EquipoiseError:  # what could not be read is in the table, with its reason
            continue
        first = not any(trace["legendgroup"] == kind for trace in data)
        offset = trial.offset if isinstance(trial, CommandedLift) and verdict is not None else None
        where = "" if offset is None else f", offset {1000 * offset:+.1f} mm"
        hover = f"lift {number}, {kind}{where}: %{{y:.2f}} deg<extra></extra>"
        group = {"legendgroup": kind, "showlegend": first, "hovertemplate": hover}
        style = {"width": 1.4}
        data.append(line(time, np.degrees(angle), kind, kinds.index(kind), line=style, opacity=0.8, **group))
    if not data:
        return None
    caption = (
        f"Tilt of the centre of mass about the line {diagonal}, from unloading two feet until they come down again."
    )
    return figure(f"Lifts on {diagonal}", caption, data, axes("time [s]", "tilt, forward positive [deg]"))


def bracket_figure(result: Calibration) -> Block | None:
    """How the bounds of both searches closed in; method `paper`."""
    if not result.support_lines or result.robot_model is None:
        return None
    start = _first_bracket(result, result.robot_model)
    data: list[Block] = []
    for series, diagonal in enumerate(DIAGONALS):
        lifts = tried_offsets(result, diagonal)
        lower, upper = narrowing(lifts, start)
        number = list(range(len(lower)))
        style = {"shape": "hv"}
        data.append(line(number, 1000 * lower, diagonal, series, line=style, legendgroup=diagonal, showlegend=False))
        data.append(line(number, 1000 * upper, f"bounds {diagonal}", series, line=style, legendgroup=diagonal, fill="tonexty",
                         fillcolor=f"{SERIES[series]}-faint"))  # fmt: skip
        data.append({
            "type": "scatter", "mode": "markers", "name": f"tried {diagonal}", "legendgroup": diagonal,
            "x": [index + 1 for index in range(len(lifts))], "y": short(1000 * lift.offset for lift in lifts),
            "marker": {"symbol": [_SYMBOLS[lift.verdict] for lift in lifts], "size": 10,
                       "color": SERIES[series]},
            "text": [lift.verdict for lift in lifts], "hovertemplate": "lift %{x}: %{y:.1f} mm, %{text}<extra></extra>",
        })  # fmt: skip
    caption = (
        "Offsets of the support line that were tried, and the bounds left after each lift. Triangles point up where the robot "
        "tipped forward, down where it tipped backward; circles: it stayed balanced."
    )
    return figure(
        "The search closes in", caption, data, axes("lifts on the diagonal", "offset of the support line [mm]")
    )


def _first_bracket(result: Calibration, robot: RobotModel) -> Bracket:
    return ComSearchSettings(**result.settings["com_search"]).bracket(nominal_stance(robot))


def narrowing(lifts: Sequence[TriedOffset], start: Bracket) -> tuple[FloatArray, FloatArray]:
    """(n + 1,) lower and upper bound before the first lift and after each [m]."""
    brackets = list(accumulate(lifts, step, initial=start))
    return np.array([bracket.lower for bracket in brackets]), np.array([bracket.upper for bracket in brackets])


def error_figure(result: Calibration) -> Block | None:
    """Fig. 3: planar CoM error against the number of halvings; method `paper`, in simulation."""
    if not result.support_lines or result.truth is None or result.evidence is None or result.robot_model is None:
        return None
    found = com_by_iteration(result, _first_bracket(result, result.robot_model)) - result.truth.composite.com[:2]
    error = 1000 * np.hypot(*found.T)
    data = [line(range(1, len(error) + 1), error, "error", 0, mode="lines+markers")]
    layout = axes("halvings of both brackets", "planar error [mm]")
    layout["xaxis"]["dtick"], layout["yaxis"]["rangemode"] = 1, "tozero"
    caption = (
        f"Distance of the centre of mass from the truth as it would have been found after each halving (the paper's Fig. 3); "
        f"{error[-1]:.1f} mm at the end."
    )
    return figure("Error by iteration", caption, data, layout)


def trial_table(result: Calibration) -> Block | None:
    """Every motion; columns in which nothing is known are left out."""
    if not result.trials:
        return None
    columns: dict[str, Callable[[Trial], str]] = {
        "kind": lambda trial: trial.kind,
        "about": lambda trial: trial.about,
        "|offset [mm]": lambda trial: _or_nothing(trial.offset, 1000, "+.1f"),
        "|lift height [mm]": lambda trial: _or_nothing(trial.lift_height, 1000, ".0f"),
        "|tilt [deg]": lambda trial: _or_nothing(trial.tilt, 57.29578, "+.2f"),
        "verdict": lambda trial: trial.verdict or "",
        "|duration [s]": lambda trial: f"{trial.duration:.1f}",
        "|misfit": lambda trial: _or_nothing(trial.misfit, 1, ".2f"),
        "note": lambda trial: trial.note or "",
    }
    shown = {name: tell_of for name, tell_of in columns.items() if any(tell_of(trial) for trial in result.trials)}
    rows = [
        [str(number), *(tell_of(trial) for tell_of in shown.values())]
        for number, trial in enumerate(result.trials, start=1)
    ]
    caption = f"All {len(result.trials)} motions, {sum(trial.duration for trial in result.trials):.0f} s of robot time"
    return table(["|#", *shown], rows, caption, folded=True)


def _or_nothing(value: float | None, factor: float, form: str) -> str:
    return "" if value is None else tell(value * factor, form)
