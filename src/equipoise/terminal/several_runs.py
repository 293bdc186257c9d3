"""Comparison of two runs in the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape

from equipoise.figures.numbers import estimated, in_shown_unit, numbers_table
from equipoise.result.legend import verdict_message
from equipoise.result.shown import ROWS
from equipoise.terminal.rich_tables import print_table, show_table

if TYPE_CHECKING:
    from equipoise.calibration.payload_change import PayloadChange

_NONE = "No significant payload was added or removed. Change of the whole robot:"
_UNSURE = (
    "The data do not determine whether anything was added or removed. Weigh the robot before and after and pass --mass "
    "BEFORE AFTER. Change of the whole robot:"
)
_CHANGES = {
    "no change": "no change: the interval contains zero and is narrow",
    "not identified": "not identified: the interval contains zero and is wide",
}


def print_payload_truth(change: PayloadChange) -> None:
    """Print mass and CoM of the payload with their ground truth, if both runs are simulated."""
    shown = [one for one in estimated(change.payload)[:4] if one.truth is not None]
    if shown:
        table = numbers_table(shown, "Payload and ground truth")
        print_table(Console(), table, without=["verdict", "|model", "|change"])
    if missed := verdict_message(shown, {}):
        print(missed)


def print_payload_change(change: PayloadChange) -> None:
    """Print the payload with intervals, and the change of the whole robot."""
    console = Console()
    for warning in change.warnings:
        console.print(f"[yellow]warning:[/yellow] {escape(warning)}")
    verb = "removed" if change.removed else "added"
    title = f"{change.robot}: payload that was {verb}; CoM in the base frame, inertia about its own CoM"
    print_table(console, numbers_table(estimated(change.payload), title), without=["|model", "|change"])
    if change.payload.com_in_base.x.value is None:
        console.print(_NONE if change.payload.mass.verdict == "no change" else _UNSURE)
    rows = [
        [row.label, in_shown_unit(one, one.value, "+"), in_shown_unit(one, one.half_width), one.verdict or ""]
        for one, row in zip(change.change, ROWS, strict=True)
    ]
    show_table("Whole robot at its stance, after minus before", ["parameter", "|change", "|95 % +-", ""], rows)
    meanings = verdict_message(change.change, _CHANGES)
    console.print(f"CoM from the origin of the base link, inertia about the CoM. {meanings}")
    if any(quantity.missed for quantity in change.payload):
        console.print("(!): the truth is outside the interval.")
    if None not in change.provenance.get("masses", (None,)):
        gain, noise = change.provenance["scale_gain_std"], change.provenance["scale_noise_std"]
        console.print(
            f"assumed: one scale weighed both runs; its readings share an error of {gain:.1%}, and each has one of "
            f"{noise:.1%} (standard deviations): --scale-gain-std, --scale-noise-std"
        )
