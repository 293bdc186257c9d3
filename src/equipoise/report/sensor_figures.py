"""Figures and table of estimated sensor errors (method `bayesian`)."""

from __future__ import annotations

import numpy as np

from equipoise.figures.blocks import INK, SERIES, Block, Cell, DataTable, Figure, axes, number, plain, short
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
    figures = [_bars("Joint offsets and IMU orientation", angles, "deg", float(np.degrees(1.0)))] if angles else []
    return figures + ([_bars("IMU position", lengths, "mm", 1000.0)] if lengths else [])


def _bars(title: str, found: list[SensorFinding], unit: str, factor: float) -> Figure:
    """Return a figure of the largest errors; `factor` converts from SI to the unit shown."""
    shown = sorted(found, key=lambda finding: -abs(finding.value))[:_SHOWN][::-1]
    names = [plain(finding.name) for finding in shown]
    data = [{
        "type": "bar", "orientation": "h", "x": short(factor * finding.value for finding in shown),
        "y": [f"<b>{name}</b>" if finding.significant else name for name, finding in zip(names, shown, strict=True)],
        "error_x": {"type": "data", "array": short(factor * finding.half_width for finding in shown), "color": INK,
                    "thickness": 1.2, "width": 3},
        "marker": {"color": [SERIES[1] if finding.significant else SERIES[0] for finding in shown]},
        "hovertemplate": f"%{{y}}: %{{x:.2f}} {unit}<extra></extra>",
    }]  # fmt: skip
    bold = " Bold: significant errors; correct them." if any(finding.significant for finding in shown) else ""
    caption = f"Estimate minus the model's value, with the 95 % interval; the {len(shown)} largest.{bold}"
    return Figure(title, caption, data, axes(f"error [{unit}]", ""), height=90 + 24 * len(shown))
