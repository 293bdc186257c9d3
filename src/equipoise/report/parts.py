"""What was found about each joint's motor and each link: a table, left above right, and a figure for each quantity."""

from __future__ import annotations

import numpy as np

from equipoise.report.blocks import SERIES, Block, axes, figure, plain, short, table, text
from equipoise.result.calibration import Calibration
from equipoise.result.shown import Shown
from equipoise.terminal.parts import Parts, parts_of

LINKS, MOTORS = "links", "motors"


def part_blocks(result: Calibration, kind: str) -> list[Block]:
    """Of "motors" or "links": nothing, if the run did not look at them; without the table, if the page begins with it."""
    blocks: list[Block] = []
    for parts in parts_of(result):
        if parts.kind == kind:
            figures = [_figure(parts, one) for one in parts.columns]
            leading = [] if motors_alone(result) else [part_table(parts)]
            blocks += [*leading, {"type": "figures", "figures": figures}, text(parts.remark)]
    return blocks


def motors_alone(result: Calibration) -> bool:
    """Whether the run looked at motors and nothing else."""
    return bool(result.motors) and result.composite.mass.value is None


def part_table(parts: Parts) -> Block:
    """All that was found about them."""
    rows = [[name, *(cell.replace("-", "\u2212") for cell in cells)] for name, *cells in parts.rows(" \u00b1 ")]
    columns = [parts.each, *(f"|{one.label}" for one in parts.columns)]
    title = f"Each {parts.each}'s motor" if parts.kind == MOTORS else f"Each {parts.each}"
    return table(columns, rows, f"{title}, {' '.join(['half 95 % intervals; left above right.', *parts.legend])}")


def motor_sentence(result: Calibration) -> str:
    """What was found about motors, in short; empty if nothing."""
    said: list[str] = []
    for parts in parts_of(result):
        for one in parts.columns if parts.kind == MOTORS else ():
            values = [quantity.value for quantity in parts.of(one.name) if quantity.value is not None]
            if values and one.name != "relative_gain":
                low, high = (f"{one.factor * end:.3g}" for end in (min(values), max(values)))
                unit = one.label.split("[")[1].rstrip("]")
                said.append(f"{one.words} {low if low == high else f'{low} to {high}'} {unit}")
    return f"Of its motors: {', '.join(said)}." if said else ""


def _figure(parts: Parts, shown: Shown) -> Block:
    """Estimates with their intervals, the first part on top."""
    names = [plain(name) for name in parts.found]
    found = parts.of(shown.name)
    values, halves, truths = (
        [np.nan if getattr(one, what) is None else shown.factor * getattr(one, what) for one in found]
        for what in ("value", "half", "truth")
    )
    data: list[Block] = [{
        "type": "scatter", "mode": "markers", "name": "found, 95 %", "x": short(values), "y": names,
        "error_x": {"type": "data", "array": short(halves), "color": SERIES[0], "thickness": 1.4, "width": 3},
        "marker": {"color": SERIES[0], "size": 7}, "hovertemplate": "%{y}: %{x}<extra></extra>",
    }]  # fmt: skip
    models = [np.nan if one.model is None else shown.factor * one.model for one in found]
    if np.isfinite(models).any():
        data.append({
            "type": "scatter", "mode": "markers", "name": "model file", "x": short(models), "y": names,
            "marker": {"color": "--ink", "symbol": "circle-open", "size": 7},
            "hovertemplate": "%{y}: %{x}, model<extra></extra>",
        })  # fmt: skip
    if np.isfinite(truths).any():
        data.append({
            "type": "scatter", "mode": "markers", "name": "truth", "x": short(truths), "y": names,
            "marker": {"color": "--ink", "symbol": "x-thin", "size": 7, "line": {"width": 1.6, "color": "--ink"}},
            "hovertemplate": "%{y}: %{x}, truth<extra></extra>",
        })  # fmt: skip
    layout = axes(shown.label, "")
    layout["yaxis"] |= {"automargin": True, "autorange": "reversed"}
    beside = ", and what was simulated" if np.isfinite(truths).any() else ""
    return figure(
        shown.words.capitalize(),
        f"Of each {parts.each}, with its 95 % interval{beside}.",
        data,
        layout,
        height=110 + 20 * len(names),
    )
