"""Figures and table of estimated sensor errors (method `bayesian`)."""

from __future__ import annotations

import numpy as np

from equipoise.figures.blocks import Block, Cell, DataTable, Figure, number, plain
from equipoise.report.part_figures import interval_figure
from equipoise.result.calibration import Calibration
from equipoise.result.findings import SensorFinding

_SHOWN = 15


def sensor_blocks(result: Calibration) -> list[Block]:
    """Return joint offsets and IMU mounting as figures, and all sensor errors as a table."""
    if not result.sensors:
        return []
    rows = [
        [Cell(one.message, "strong" if one.significant else ""), number(one.value, 1, ".3g"), number(one.half_width, 1, ".2g"),
         one.unit, "correct it" if one.significant else ""]
        for one in result.sensors
    ]  # fmt: skip
    title = f"All {len(rows)} sensor errors, the most significant first"
    return [*_figures(result), DataTable(title, ["error", "|value", "|95 % +-", "unit", ""], rows, folded=True)]


def _figures(result: Calibration) -> list[Figure]:
    """Return a figure of joint offsets and IMU orientation, and one of the IMU position."""
    found = [one for one in result.sensors if one.name.endswith(" offset") or one.name.startswith("IMU ")]
    angles, lengths = ([one for one in found if one.unit == unit] for unit in ("rad", "m"))
    figures = [_largest("Joint offsets and IMU orientation", angles, "deg", float(np.degrees(1.0)))] if angles else []
    return figures + ([_largest("IMU position", lengths, "mm", 1000.0)] if lengths else [])


def _largest(title: str, found: list[SensorFinding], unit: str, factor: float) -> Figure:
    """Return a figure of the largest errors; `factor` converts from SI to the unit shown."""
    shown = sorted(found, key=lambda finding: -abs(finding.value))[:_SHOWN]
    names = [f"<b>{plain(one.name)}</b>" if one.significant else plain(one.name) for one in shown]
    bold = " Bold: significant errors; correct them." if any(finding.significant for finding in shown) else ""
    caption = f"Estimate minus the model's value, with the 95 % interval; the {len(shown)} largest.{bold}"
    return interval_figure(title, caption, f"error [{unit}]", names, shown, factor)
