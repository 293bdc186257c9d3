"""Causes of a lean in the terminal."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np
from rich.console import Console
from rich.markup import escape

from equipoise.estimator.diagnostics.causes import Cause, Diagnosis
from equipoise.result.quantity import Quantity
from equipoise.terminal.rich_tables import print_wrapped, show_table

_SHOWN_ABOVE = 1.0  # normal deviate; one of six causes without an error exceeds it
_UNITS = {"rad": (math.degrees(1.0), "deg", "+.2f"), "m": (1000.0, "mm", "+.1f"), "kg": (1.0, "kg", "+.2f")}
_FRACTION = (100.0, "%", "+.1f")
_NAMES = {"com_x": "CoM x of the robot", "com_y": "CoM y of the robot"}


def print_diagnosis(found: Diagnosis, failed: Sequence[str], run: str | None) -> None:
    """Print the causes of a lean with their sizes, and what to change.

    Args:
        failed: names of the failed checks.
        run: run to export, for the commands of the changes; None for a log, whose result is not saved.
    """
    console = Console(emoji=False)
    significant, possible, out = (
        [cause for cause in found.causes if cause.verdict == verdict]
        for verdict in ("significant", "possible", "ruled out")
    )
    likely = [cause for cause in possible if cause.deviate > _SHOWN_ABOVE]
    shown = [*significant, *likely]
    heads = ["cause", "|CoM shift [mm]", "|95 % +-", "|roll, pitch [deg]", "verdict"]
    if shown:
        show_table(f"{found.robot}: causes of a lean at the stance", heads, [*map(_row, shown)], console)
        console.print("CoM shift: of the centre of mass over the feet, forward and to the left.")
    if not significant:
        console.print(f"{found.robot}: no cause is significant; more motions determine smaller ones")
    for cause in significant:
        values, export = ", ".join(map(_value, cause.values)), f"export {run or 'FILE'}"
        print_wrapped(console, escape(f"{cause.name}: {values}: {cause.change.replace('export RUN', export)}"))
    if significant and run is None:
        print_wrapped(console, "To write FILE, use 'equipoise estimate' with --out FILE; export it with --file MODEL.")
    for name in (cause.name for cause in shown if cause.name in {name for name, *_ in found.inseparable}):
        others = ", ".join(f"{other} ({value:.2f})" for one, other, value in found.inseparable if one == name)
        console.print(escape(f"{name} is not separated by these data from (correlation): {others}"))
    for words, causes in (("not determined", possible[len(likely) :]), ("ruled out", out)):
        if causes:
            largest = 1000 * max(cause.size + cause.bound for cause in causes)
            console.print(f"{words}: {_counted(causes)}, CoM shift up to {largest:.1f} mm")
    if failed:
        console.print(escape(f"failed checks, see 'equipoise estimate': {', '.join(failed)}"))


def _row(cause: Cause) -> list[str]:
    ahead, left = 1000 * cause.shift
    lean = "-" if cause.lean is None else "{:+.2f}, {:+.2f}".format(*np.degrees(cause.lean))
    return [cause.name, f"{ahead:+.1f}, {left:+.1f}", f"{1000 * cause.bound:.1f}", lean, cause.verdict]


def _value(quantity: Quantity) -> str:
    factor, unit, form = _UNITS.get(quantity.unit, _FRACTION)
    value, std = (factor * float(number or 0.0) for number in (quantity.value, quantity.std))
    return f"{_NAMES.get(quantity.name, quantity.name)} {value:{form}} {unit} (std {std:{form[1:]}})"


def _counted(causes: Sequence[Cause]) -> str:
    counts = Counter(cause.kind.replace("_", " ") for cause in causes)
    return ", ".join(kind if count == 1 else f"{count} {kind}s" for kind, count in counts.items())
