"""Figures and tables of residuals and of held-out predictions."""

from __future__ import annotations

from equipoise.estimator.posterior_evidence import PosteriorEvidence
from equipoise.figures.blocks import SERIES, Block, Cell, DataTable, Figure, Trace, axes, level, pieces, plain, short
from equipoise.result.calibration import Calibration, Trial

_KINDS = (("lift", "lift", ""), ("posture", "stance motion", "/"), ("walk", "walk (its worst step)", "\\"))
_RATIO = "normalized residual (rms / expected noise)"
_HOLLOW = "rgba(0,0,0,0)"


def residual_figures(result: Calibration) -> list[Figure]:
    """Return the figure of the normalized residual of each motion, for methods that have these."""
    judged = [
        (number, trial) for number, trial in enumerate(result.trials, start=1) if trial.normalized_residual is not None
    ]
    if not judged:
        return []
    bars: list[Trace] = []
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
    layout = axes("motion", _RATIO)
    layout["shapes"] = [level(1)]
    return [Figure("Residual of each motion", _about_one([trial for _, trial in judged]), bars, layout)]


def _about_one(trials: list[Trial]) -> str:
    """Return the meaning of level 1 and of hollow bars, for the motions of this run."""
    notes = ["1: the residual equals the expected noise."]
    if any(trial.kind == "posture" for trial in trials):
        notes.append(
            "Stance motions: the expected noise is a fixed allowance for creeping feet, twice that of an ideal robot, "
            "because consecutive motions share a rest. If the feet do not creep, these residuals are below 1."
        )
    if any(trial.note for trial in trials):
        notes.append("Hollow bars: motions excluded from the estimate.")
    return " ".join(notes)


def held_out_blocks(result: Calibration) -> list[Block]:
    """Return a summary, the errors over time if recordings are available, and the errors by predicting body."""
    predicted = result.held_out
    if predicted is None:
        return []
    rows: list[list[str | Cell]] = [
        [body, f"{1000 * predicted.error(body):.2f}", f"{predicted.relative_error(body):.1f}",
         f"{predicted.inside(body)} of {len(predicted.lifts)}"]
        for body in reversed(predicted.bodies)
    ]  # fmt: skip
    columns = ["body", "|rms error [mm]", "|error / half width (rms)", "|inside the interval"]
    kind = predicted.lifts[0].kind
    caption = f"CoM errors at the end of each {kind}; sensors and floor are estimated without {predicted.left_out}"
    return [f"{predicted.message()}.", *_errors_over_time(result), DataTable(caption, columns, rows)]


def _errors_over_time(result: Calibration) -> list[Figure]:
    evidence = result.evidence
    if not isinstance(evidence, PosteriorEvidence) or not evidence.predictions:
        return []
    lines = [
        pieces([(one.time, 1000 * one.height * one.errors[body]) for one in evidence.predictions], body, series)
        for series, body in enumerate(reversed(tuple(evidence.predictions[0].errors)))
    ]
    kind = evidence.predictions[0].kind
    caption = (
        f"Measured minus predicted tilt about the support line of each {kind}, as displacement of the centre of mass."
    )
    layout = axes("time on two feet [s]", "tilt error at the CoM [mm]")
    return [Figure(f"Prediction errors of held-out {kind}s", caption, lines, layout)]
