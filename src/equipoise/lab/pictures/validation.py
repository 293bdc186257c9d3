"""Lifts played again in simulation: how far each body tips from what was measured, over time."""

# pyright: reportUnknownMemberType=false
# Matplotlib's own stubs leave **kwargs without a type, which makes every method that takes them partially unknown.

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from equipoise.lab.replay.validation import Validation
from equipoise.pictures.figure import BLUE, GREEN, LIGHT_GREY, PURPLE, SMALL, TEXT, VERMILLION, new_figure
from equipoise.pictures.files import save_figures

_COLOURS, _DASHES = (BLUE, VERMILLION, GREEN, PURPLE), ("solid", "dashed", "dotted", "dashdot")


def draw_validation(found: Validation) -> Figure:
    """A line a lift and body: measured less simulated tilt, as a way of the CoM about the support line."""
    figure = new_figure(8.0, 5.0)
    figure.set_layout_engine(ConstrainedLayoutEngine(h_pad=0.08, w_pad=0.08))
    axes = figure.subplots()
    for index, body in reversed([*enumerate(found.bodies)]):  # what was found on top
        colour, dash = _COLOURS[index % 4], _DASHES[index % 4]
        for number, lift in enumerate(found.lifts):
            label = f"{body}: {1000 * found.error(body):.2f} mm rms" if not number else None
            error = 1000 * lift.seen.height * lift.errors[body]
            axes.plot(lift.seen.time, error, label=label, color=colour, linestyle=dash, linewidth=1.0)
    axes.set_title(f"{found.robot}: {len(found.lifts)} lifts played again", fontsize=TEXT)
    axes.set_xlabel("time on two feet [s]", fontsize=TEXT)
    axes.set_ylabel("measured less simulated tilt, at the CoM [mm]", fontsize=TEXT)
    axes.grid(color=LIGHT_GREY)
    axes.set_axisbelow(True)
    axes.legend(fontsize=SMALL, frameon=False)
    return figure


def save_validation(found: Validation, path: Path) -> Path:
    """Write the picture; raises OutputError if that fails."""
    return save_figures({path.name: draw_validation(found)}, path.parent)[0]
