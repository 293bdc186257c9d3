"""Tables and figures of the estimated properties of motors and links."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from equipoise.figures.blocks import INK, SERIES, Block, Figure, axes, plain, points, short
from equipoise.figures.parts import motors_alone, parts_of
from equipoise.result.calibration import Calibration
from equipoise.result.findings import SensorFinding
from equipoise.result.quantity import Quantity

LINKS, MOTORS = "links", "motors"
_LOOKS = {
    "model": {"color": INK, "symbol": "circle-open", "size": 7},
    "truth": {"color": INK, "symbol": "x-thin", "size": 7, "line": {"width": 1.6, "color": INK}},
}


def part_blocks(result: Calibration, kind: str) -> list[Block]:
    """Return table and figures of "motors" or "links"; without the table if the top of the page shows it."""
    blocks: list[Block] = []
    for parts in parts_of(result):
        if parts.kind == kind:
            leading = [] if motors_alone(result) else [parts.table()]
            names, caption = [plain(name) for name in parts.found], f"Estimate and 95 % interval for each {parts.each}."
            figures = [
                interval_figure(one.words.capitalize(), caption, one.label, names, parts.of(one.name), one.factor)
                for one in parts.columns
            ]
            blocks += [*leading, *figures, parts.remark]
    return blocks


def motor_message(result: Calibration) -> str:
    """Return the ranges of the estimated motor parameters; empty without any."""
    ranges: list[str] = []
    for parts in parts_of(result):
        for one in parts.columns if parts.kind == MOTORS else ():
            values = [quantity.value for quantity in parts.of(one.name) if quantity.value is not None]
            if values and one.name != "relative_gain":
                low, high = (f"{one.factor * end:.3g}" for end in (min(values), max(values)))
                unit = one.label.split("[")[1].rstrip("]")
                ranges.append(f"{one.words} {low if low == high else f'{low} to {high}'} {unit}")
    return f"Motors: {', '.join(ranges)}." if ranges else ""


def interval_figure(
    title: str, caption: str, label: str, names: Sequence[str], found: Sequence[Quantity | SensorFinding], factor: float
) -> Figure:
    """Return a figure of estimates with 95 % intervals, model values and ground truth, the first one on top.

    Args:
        label: title of the axis, with the unit.
        names: name of each estimate.
        factor: from SI to the unit shown.
    """
    values = {
        what: [np.nan if (value := getattr(one, what, None)) is None else factor * value for one in found]
        for what in ("value", "half_width", "model", "truth")
    }
    interval = {"type": "data", "array": short(values["half_width"]), "color": SERIES[0], "thickness": 1.4, "width": 3}
    data = [points(values["value"], names, "estimate, 95 %", {"color": SERIES[0], "size": 7}, error_x=interval)]
    data += [
        points(values[what], names, what, look) for what, look in _LOOKS.items() if np.isfinite(values[what]).any()
    ]
    layout = axes(label, "")
    layout["yaxis"] |= {"autorange": "reversed"}
    return Figure(title, caption, data, layout, height=110 + 20 * len(names))
