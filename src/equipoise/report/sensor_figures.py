"""Estimated sensor errors; method `precise`."""

from __future__ import annotations

import numpy as np

from equipoise.figures.blocks import INK, SERIES, Block, Cell, DataTable, Figure, axes, number, plain, short
from equipoise.result.calibration import Calibration

_SHOWN = 15


def sensor_blocks(result: Calibration) -> list[Block]:
    """Return joint zeros and IMU mounting as a figure, and all sensor errors as a table."""
    if not result.sensors:
        return []
    rows = [
        [Cell(one.sentence, "strong" if one.notable else ""), number(one.value, 1, ".3g"), number(one.half, 1, ".2g"),
         "worth fixing" if one.notable else ""]
        for one in result.sensors
    ]  # fmt: skip
    title = f"All {len(rows)} sensor errors, the most significant first"
    return [*_angles(result), DataTable(title, ["error", "|value (SI)", "|95 % +-", ""], rows, folded=True)]


def _angles(result: Calibration) -> list[Figure]:
    angles = [one for one in result.sensors if one.name.endswith(" zero") or one.name.startswith("IMU ")]
    shown = sorted(angles, key=lambda finding: -abs(finding.value))[:_SHOWN][::-1]
    if not shown:
        return []
    halves = short(np.degrees([finding.half for finding in shown]))
    data = [{
        "type": "bar", "orientation": "h", "y": [plain(finding.name.replace("_", " ")) for finding in shown],
        "x": short(np.degrees([finding.value for finding in shown])),
        "error_x": {"type": "data", "array": halves, "color": INK, "thickness": 1.2, "width": 3},
        "marker": {"color": [SERIES[1] if finding.notable else SERIES[0] for finding in shown],
                   "pattern": {"shape": ["/" if finding.notable else "" for finding in shown]}},
        "hovertemplate": "%{y}: %{x:.2f} deg<extra></extra>",
    }]  # fmt: skip
    caption = "Errors of joint zeros and of the IMU's mounting, the largest. Hatched: significant, and worth fixing."
    layout = axes("off by [deg], 95 %", "")
    return [Figure("Joint zeros and IMU mounting", caption, data, layout, height=90 + 24 * len(shown))]
