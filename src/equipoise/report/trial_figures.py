"""Figure of the CoM search, and the table of all motions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import accumulate

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.figures.blocks import SERIES, DataTable, Figure, Trace, axes, line, number, points, short
from equipoise.paper.bracket import Bracket, TriedOffset, step
from equipoise.paper.iterations import tried_offsets
from equipoise.paper.settings import ComSearchSettings
from equipoise.result.calibration import Calibration, Trial
from equipoise.robot.model import DIAGONALS
from equipoise.robot.stance import nominal_stance

_SYMBOLS = {"forward": "triangle-up", "backward": "triangle-down", "balanced": "circle"}


def search_figures(result: Calibration) -> list[Figure]:
    """Return the convergence of both searches (method `paper`)."""
    robot = result.robot_model
    if not result.support_lines or robot is None:
        return []
    start = ComSearchSettings(**result.settings["com_search"]).bracket(nominal_stance(robot))
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
    layout = axes("lifts on the diagonal", "offset of the support line [mm]")
    return [Figure("Convergence of the search", caption, data, layout)]


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
