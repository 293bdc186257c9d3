"""What was found wrong with the sensors; method `precise`."""

from __future__ import annotations

import numpy as np

from equipoise.report.blocks import SERIES, Block, axes, figure, plain, short, table
from equipoise.report.numbers import tell
from equipoise.result.calibration import Calibration

_SHOWN = 15


def sensor_blocks(result: Calibration) -> list[Block]:
    """Joint zeros and IMU mounting as a figure, all findings in words."""
    if not result.sensors:
        return []
    rows = [
        [{"text": finding.sentence, "tone": "strong" if finding.notable else ""}, tell(finding.value, ".3g"),
         f"\u00b1 {finding.half:.2g}", "worth fixing" if finding.notable else ""]
        for finding in result.sensors
    ]  # fmt: skip
    found = table(
        ["what", "|value (SI)", "95 %", ""], rows, f"All {len(rows)} sensor errors, the surest first", folded=True
    )
    return [*_angles(result), found]


def _angles(result: Calibration) -> list[Block]:
    angles = [
        finding for finding in result.sensors if finding.name.endswith(" zero") or finding.name.startswith("IMU ")
    ]
    shown = sorted(angles, key=lambda finding: -abs(finding.value))[:_SHOWN][::-1]
    if not shown:
        return []
    data = [{
        "type": "bar", "orientation": "h", "y": [plain(finding.name.replace("_", " ")) for finding in shown],
        "x": short(np.degrees([finding.value for finding in shown])),
        "error_x": {"type": "data", "array": short(np.degrees([finding.half for finding in shown])),
                    "color": "--ink", "thickness": 1.2, "width": 3},
        "marker": {"color": [SERIES[1] if finding.notable else SERIES[0] for finding in shown],
                   "pattern": {"shape": ["/" if finding.notable else "" for finding in shown]}},
        "hovertemplate": "%{y}: %{x:.2f} deg<extra></extra>",
    }]  # fmt: skip
    layout = axes("off by [deg], 95 %", "")
    layout["yaxis"]["automargin"] = True
    caption = "Errors of joint zeros and of the IMU's mounting, the largest. Hatched: sure, and worth fixing."
    return [figure("Joint zeros and IMU mounting", caption, data, layout, height=90 + 24 * len(shown))]
