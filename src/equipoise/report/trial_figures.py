"""Figures of tilts and of the CoM search, and the table of all motions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import accumulate

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import EquipoiseError
from equipoise.experiments.tilt import tilt_curve
from equipoise.figures.blocks import SERIES, DataTable, Figure, Trace, axes, line, number, points, short
from equipoise.paper.bracket import Bracket, TriedOffset, step
from equipoise.paper.iterations import com_by_iteration, tried_offsets
from equipoise.paper.settings import ComSearchSettings
from equipoise.recording.recording import Recording
from equipoise.recording.trials import MEANWHILE, CommandedLift, DesignedLift, LiftTrial
from equipoise.result.calibration import Calibration, Trial
from equipoise.robot.model import DIAGONALS, RobotModel
from equipoise.robot.stance import nominal_stance

_POINTS = 40  # per curve
_VERDICTS = ("forward", "backward", "balanced")
_SYMBOLS = {"forward": "triangle-up", "backward": "triangle-down", "balanced": "circle"}


def tilt_figures(result: Calibration) -> list[Figure]:
    """Return the tilt of all lifts over time, one figure for each diagonal."""
    evidence, robot = result.evidence, result.robot_model
    if evidence is None or robot is None:
        return []
    lifts = [
        (trial, recording)
        for recording in evidence.recordings
        if isinstance(trial := recording.trial, LiftTrial) and recording.complete
    ]
    judged = [trial.verdict for trial in result.trials if trial.kind == "lift" and trial.verdict is not None]
    verdicts = judged if len(judged) == len(lifts) else [None] * len(lifts)
    numbered = [(index, *lift, verdict) for index, (lift, verdict) in enumerate(zip(lifts, verdicts, strict=True), 1)]
    figures = [_tilts(robot, name, [one for one in numbered if one[1].diagonal == name]) for name in DIAGONALS]
    return [one for one in figures if one.data]


def _tilts(robot: RobotModel, diagonal: str, lifts: list[tuple[int, LiftTrial, Recording, str | None]]) -> Figure:
    data: list[Trace] = []
    for index, trial, recording, verdict in lifts:
        kind = verdict or (trial.meanwhile if isinstance(trial, DesignedLift) else "passive")
        kinds = _VERDICTS if kind in _VERDICTS else MEANWHILE
        try:
            time, angle = tilt_curve(robot, recording, diagonal, _POINTS)
        except EquipoiseError:  # the table of motions shows the lift with its reason
            continue
        first = not any(trace["legendgroup"] == kind for trace in data)
        offset = trial.offset if isinstance(trial, CommandedLift) and verdict is not None else None
        where = "" if offset is None else f", offset {1000 * offset:+.1f} mm"
        hover = f"lift {index}, {kind}{where}: %{{y:.2f}} deg<extra></extra>"
        group = {"legendgroup": kind, "showlegend": first, "hovertemplate": hover, "opacity": 0.8}
        data.append(line(time, np.degrees(angle), kind, kinds.index(kind), line={"width": 1.4}, **group))
    caption = f"Tilt of the centre of mass about the support line {diagonal}, from unloading of two feet to touchdown."
    return Figure(f"Lifts on {diagonal}", caption, data, axes("time [s]", "tilt, forward positive [deg]"))


def search_figures(result: Calibration) -> list[Figure]:
    """Return the convergence of both searches, and Fig. 3 of the paper in simulation (method `paper`)."""
    robot = result.robot_model
    if not result.support_lines or robot is None:
        return []
    start = ComSearchSettings(**result.settings["com_search"]).bracket(nominal_stance(robot))
    simulated = result.truth is not None and result.evidence is not None
    return [_brackets(result, start), *([_errors(result, start)] if simulated else [])]


def _brackets(result: Calibration, start: Bracket) -> Figure:
    data: list[Trace] = []
    for series, diagonal in enumerate(DIAGONALS):
        lifts = tried_offsets(result, diagonal)
        lower, upper = (1000 * bound for bound in narrowing(lifts, start))
        count = range(len(lower))
        group = {"line": {"shape": "hv"}, "legendgroup": diagonal}
        data.append(line(count, lower, diagonal, series, showlegend=False, **group))
        data.append(
            line(count, upper, f"bounds {diagonal}", series, fill="tonexty", fillcolor=f"{SERIES[series]}20", **group)
        )
        verdicts = [lift.verdict for lift in lifts]
        marker = {"symbol": [_SYMBOLS[verdict] for verdict in verdicts], "size": 10, "color": SERIES[series]}
        hover = {"text": verdicts, "hovertemplate": "lift %{x}: %{y:.1f} mm, %{text}<extra></extra>"}
        offsets = short(1000 * lift.offset for lift in lifts)
        data.append(points(count[1:], offsets, f"tried {diagonal}", marker, legendgroup=diagonal, **hover))
    caption = (
        "Offsets of the support line in each lift, and the bounds after it. Triangle up: the robot tipped forward; triangle "
        "down: backward; circle: it stayed balanced."
    )
    return Figure(
        "Convergence of the search", caption, data, axes("lifts on the diagonal", "offset of the support line [mm]")
    )


def _errors(result: Calibration, start: Bracket) -> Figure:
    """Return Fig. 3 of the paper: planar CoM error against the number of halvings."""
    assert result.truth is not None
    error = 1000 * np.hypot(*(com_by_iteration(result, start) - result.truth.composite.com[:2]).T)
    data = [line(range(1, len(error) + 1), error, "error", 0, mode="lines+markers")]
    layout = axes("halvings of both brackets", "planar error [mm]")
    layout["xaxis"]["dtick"], layout["yaxis"]["rangemode"] = 1, "tozero"
    caption = (
        f"Planar distance between estimated and true centre of mass after each halving (Fig. 3 of the paper); "
        f"{error[-1]:.1f} mm at the end."
    )
    return Figure("Error by iteration", caption, data, layout)


def narrowing(lifts: Sequence[TriedOffset], start: Bracket) -> tuple[FloatArray, FloatArray]:
    """Return (n + 1,) lower and upper bounds before the first lift and after each lift [m]."""
    brackets = list(accumulate(lifts, step, initial=start))
    return np.array([bracket.lower for bracket in brackets]), np.array([bracket.upper for bracket in brackets])


def trial_table(result: Calibration) -> list[DataTable]:
    """Return the table of all motions, without empty columns."""
    if not result.trials:
        return []
    columns: dict[str, Callable[[Trial], str]] = {
        "kind": lambda trial: trial.kind,
        "about": lambda trial: trial.about,
        "|offset [mm]": lambda trial: _text(trial.offset, 1000, "+.1f"),
        "|lift height [mm]": lambda trial: _text(trial.lift_height, 1000, ".0f"),
        "|tilt [deg]": lambda trial: _text(trial.tilt, 57.29578, "+.2f"),
        "verdict": lambda trial: trial.verdict or "",
        "|duration [s]": lambda trial: f"{trial.duration:.1f}",
        "|normalized residual": lambda trial: _text(trial.normalized_residual, 1, ".2f"),
        "note": lambda trial: trial.note or "",
    }
    shown = {name: text for name, text in columns.items() if any(map(text, result.trials))}
    rows = [[str(index), *(text(trial) for text in shown.values())] for index, trial in enumerate(result.trials, 1)]
    title = f"All {len(result.trials)} motions, {sum(trial.duration for trial in result.trials):.0f} s of robot time"
    return [DataTable(title, ["|#", *shown], rows, folded=True)]


def _text(value: float | None, factor: float, form: str) -> str:
    return "" if value is None else number(value, factor, form)
