"""Residuals of the motions, and held-out predictions."""

from __future__ import annotations

import numpy as np

from equipoise.estimator.posterior_evidence import PosteriorEvidence
from equipoise.figures.blocks import (
    SERIES,
    Block,
    Cell,
    DataTable,
    Figure,
    Trace,
    axes,
    level,
    line,
    pieces,
    plain,
    points,
    short,
)
from equipoise.figures.lift_planes import LiftPlanes
from equipoise.result.calibration import Calibration, Trial
from equipoise.result.held_out import FOUND

_KINDS = (("lift", "lift", ""), ("posture", "move over planted feet", "/"), ("walk", "walk, its worst step", "\\"))
_RATIO = "residual over what noise explains"
_HOLLOW = "rgba(0,0,0,0)"


def residual_figures(result: Calibration, planes: LiftPlanes) -> list[Figure]:
    """Return the figures that apply to the method."""
    return [*_residual_summary(result), *_plane_misses(result, planes), *_tilt_by_offset(result)]


def _residual_summary(result: Calibration) -> list[Figure]:
    judged = [
        (number, trial) for number, trial in enumerate(result.trials, start=1) if trial.normalized_residual is not None
    ]
    if not judged:
        return []
    bars: list[Trace] = []
    spreads: list[Trace] = []
    for series, (kind, name, pattern) in enumerate(_KINDS):
        mine = [(number, trial) for number, trial in judged if trial.kind == kind]
        if not mine:
            continue
        colour, normalized_residuals = SERIES[series], short(trial.normalized_residual or 0.0 for _, trial in mine)
        fills = [_HOLLOW if trial.note else colour for _, trial in mine]
        bars.append({
            "type": "bar", "name": name, "x": [number for number, _ in mine], "y": normalized_residuals,
            "text": [plain("; ".join(filter(None, (trial.about, trial.note)))) for _, trial in mine], "textposition": "none",
            "hovertemplate": "motion %{x}: %{y:.2f}<br>%{text}<extra></extra>",
            "marker": {"color": fills, "line": {"color": colour, "width": 1}, "pattern": {"shape": pattern}},
        })  # fmt: skip
        spreads.append({
            "type": "histogram", "name": name, "x": normalized_residuals, "xbins": {"start": 0, "size": 0.2},
            "marker": {"color": colour, "pattern": {"shape": pattern}},
        })  # fmt: skip
    middle = float(np.median([trial.normalized_residual or 0.0 for _, trial in judged]))
    layout = axes("motion", _RATIO)
    layout["shapes"] = [level(1)]
    return [
        Figure("Residual of each motion", _about_one([trial for _, trial in judged]), bars, layout),
        Figure(
            "Distribution of the residuals", f"Median {middle:.2f}.", spreads, axes(_RATIO, "motions", barmode="stack")
        ),
    ]


def _about_one(trials: list[Trial]) -> str:
    """Return the meaning of the level 1 for the kinds of motions that there are, and of hollow bars if there are any."""
    said = ["1: what noise explains."]
    if any(trial.kind == "posture" for trial in trials):
        said.append(
            "For a move over planted feet that is a fixed allowance for how feet creep, twice what an ideal robot shows, "
            "because neighbouring moves share a rest: where feet stand well, these residuals are below 1."
        )
    if any(trial.note for trial in trials):
        said.append("Hollow bars were left out.")
    return " ".join(said)


def _plane_misses(result: Calibration, planes: LiftPlanes) -> list[Figure]:
    """Return the distances of the lifts' support planes from the estimated CoM, without any sensor bias."""
    com = result.composite.com_in_base.values
    if not np.isfinite(com).all():
        return []
    misses = [1000 * lift.plane.distance_to(com) for lift in planes]
    if not misses:
        return []
    caption = (
        f"Each lift read alone, its sensors taken to be right: rms {np.sqrt(np.mean(np.square(misses))):.1f} mm. What they "
        "share is sensor errors, which the estimate finds; hence its smaller interval."
    )
    data = [{"type": "histogram", "x": short(misses), "marker": {"color": SERIES[0]}, "nbinsx": 24, "name": "lifts"}]
    layout = axes("distance, CoM ahead positive [mm]", "lifts")
    return [Figure("How far the support planes pass by the CoM", caption, data, layout)]


def _tilt_by_offset(result: Calibration) -> list[Figure]:
    """Return tilt against offset of the paper's lifts: it must change its sign at the line that was found."""
    data: list[Trace] = []
    for series, (diagonal, found) in enumerate(result.support_lines.items()):
        mine = [trial for trial in result.trials if trial.about == diagonal and trial.tilt is not None]
        offsets, tilts = (1000 * (one.offset or 0.0) for one in mine), np.degrees([one.tilt or 0.0 for one in mine])
        marker = {"color": SERIES[series], "symbol": ("circle", "diamond")[series], "size": 9}
        data.append(points(offsets, short(tilts), f"lifts on {diagonal}", marker))
        data.append(line([1000 * found.offset] * 2, [-1, 1], f"balance on {diagonal}", series, line={"width": 1}))
    caption = "Behind the centre of mass the robot tips forward, ahead of it backward."
    layout = axes("offset of the support line [mm]", "tilt [deg]")
    return [Figure("Tilt by offset", caption, data, layout)] if data else []


def held_out_blocks(result: Calibration) -> list[Block]:
    """A sentence, the errors over time if the recordings are at hand, and whose body predicts how well."""
    predicted = result.held_out
    if predicted is None:
        return []
    beside = "; ".join(
        f"with the {body}'s body they are {predicted.error(body) / predicted.error(FOUND):.1f} times as large"
        for body in predicted.bodies
        if body != FOUND
    )
    said = (
        f"{predicted.counted} were each predicted from {predicted.others} alone. Errors are "
        f"{1000 * predicted.error(FOUND):.2f} mm rms at the centre of mass; {beside}."
    )
    rows: list[list[str | Cell]] = [
        [body, f"{1000 * predicted.error(body):.2f}", f"{_in_intervals(result, body):.1f}",
         f"{predicted.inside(body)} of {len(predicted.lifts)}"]
        for body in reversed(predicted.bodies)
    ]  # fmt: skip
    columns = ["body", "|rms error [mm]", "|over half the interval", "|inside the interval"]
    kind = predicted.lifts[0].kind
    caption = f"At each {kind}'s end; sensors and floor as found without {predicted.left_out}, for all bodies"
    return [said, *_errors_over_time(result), DataTable(caption, columns, rows)]


def _in_intervals(result: Calibration, body: str) -> float:
    assert result.held_out is not None
    return float(np.sqrt(np.mean([lift.intervals[body] ** 2 for lift in result.held_out.lifts])))


def _errors_over_time(result: Calibration) -> list[Figure]:
    evidence = result.evidence
    if not isinstance(evidence, PosteriorEvidence) or not evidence.predictions:
        return []
    lines = [
        pieces([(one.time, 1000 * one.height * one.errors[body]) for one in evidence.predictions], body, series)
        for series, body in enumerate(reversed(tuple(evidence.predictions[0].errors)))
    ]
    kind = evidence.predictions[0].kind
    caption = f"A line a {kind}: measured less predicted tilt about the support line, as a way of the centre of mass."
    layout = axes("time on two feet [s]", "error of the tilt [mm]")
    return [Figure(f"{kind.capitalize()}s it has not seen", caption, lines, layout)]
