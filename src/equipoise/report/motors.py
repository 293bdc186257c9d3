"""What was found about each joint's motor: a table, left beside right, and a figure for each quantity."""

from __future__ import annotations

import numpy as np

from equipoise.report.blocks import SERIES, Block, axes, figure, plain, short, table, text
from equipoise.result.calibration import Calibration
from equipoise.result.quantity import Quantity
from equipoise.terminal.motors import COLUMNS, UNITS, left_by_right, motor_rows


def motor_blocks(result: Calibration) -> list[Block]:
    """Nothing, if the run did not look at motors; without the table, if the page begins with it."""
    if not result.motors:
        return []
    leading = [] if motors_alone(result) else [motor_table(result)]
    return [*leading, {"type": "figures", "figures": _figures(result)}, text(UNITS)]


def motors_alone(result: Calibration) -> bool:
    """Whether the run looked at motors and nothing else."""
    return bool(result.motors) and result.composite.mass.value is None


def motor_table(result: Calibration) -> Block:
    """All that was found about motors."""
    rows = [[joint, *(cell.replace("-", "\u2212") for cell in cells)] for joint, *cells in motor_rows(result, "\u00b1")]
    marks = (
        " (!): what was simulated is outside the interval."
        if any("(!)" in cell for row in rows for cell in row)
        else ""
    )
    columns = ["joint", *(f"|{label}" for _, label, *_ in COLUMNS)]
    return table(columns, rows, f"Each joint's motor, half 95 % intervals; left above right.{marks}")


def motor_sentence(result: Calibration) -> str:
    """What was found, in short."""
    said: list[str] = []
    for name, label, factor, _, words in COLUMNS:
        values = [one.value for one in _of(result, name) if one.value is not None]
        if values and name != "relative_gain":
            low, high = (f"{factor * end:.3g}" for end in (min(values), max(values)))
            said.append(f"{words} {low if low == high else f'{low} to {high}'} {label.split('[')[1].rstrip(']')}")
    return f"Of its motors: {', '.join(said)}."


def _of(result: Calibration, name: str) -> list[Quantity]:
    return [result.motors[joint].quantities[name] for joint in left_by_right(result)]


def _figures(result: Calibration) -> list[Block]:
    return [_figure(result, name, label, factor, words) for name, label, factor, _, words in COLUMNS]


def _figure(result: Calibration, name: str, label: str, factor: float, words: str) -> Block:
    """Estimates with their intervals, the first joint on top."""
    joints = [plain(joint) for joint in left_by_right(result)]
    found = _of(result, name)
    values, halves, truths = (
        [np.nan if getattr(one, what) is None else factor * getattr(one, what) for one in found]
        for what in ("value", "half", "truth")
    )
    data: list[Block] = [{
        "type": "scatter", "mode": "markers", "name": "found, 95 %", "x": short(values), "y": joints,
        "error_x": {"type": "data", "array": short(halves), "color": SERIES[0], "thickness": 1.4, "width": 3},
        "marker": {"color": SERIES[0], "size": 7}, "hovertemplate": "%{y}: %{x}<extra></extra>",
    }]  # fmt: skip
    if np.isfinite(truths).any():
        data.append({
            "type": "scatter", "mode": "markers", "name": "truth", "x": short(truths), "y": joints,
            "marker": {"color": "--ink", "symbol": "x-thin", "size": 7, "line": {"width": 1.6, "color": "--ink"}},
            "hovertemplate": "%{y}: %{x}, truth<extra></extra>",
        })  # fmt: skip
    layout = axes(label, "")
    layout["yaxis"] |= {"automargin": True, "autorange": "reversed"}
    beside = ", and what was simulated" if len(data) > 1 else ""
    return figure(
        words.capitalize(),
        f"Of each joint, with its 95 % interval{beside}.",
        data,
        layout,
        height=110 + 20 * len(joints),
    )
