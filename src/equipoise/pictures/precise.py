"""The precise method at a glance: how sure it is, how its motions fit, and what it found wrong with the sensors."""

# pyright: reportUnknownMemberType=false
# Matplotlib's own stubs leave **kwargs without a type, which makes every method that takes them partially unknown.

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from equipoise.pictures.figure import BLUE, GREEN, GREY, LIGHT_GREY, SMALL, TEXT, VERMILLION, new_figure
from equipoise.result.calibration import Calibration
from equipoise.result.quantity import Quantity

_GROUPS = (
    ("CoM in the base frame [mm]", slice(1, 4), 1000.0),
    ("moments of inertia [kg m2]", slice(4, 7), 1.0),
    ("products of inertia [kg m2]", slice(7, 10), 1.0),
)
_SHOWN_BIASES = 10


def draw_precise(calibration: Calibration) -> Figure:
    """95 % intervals beside the model's values (and the truth), misfits of all motions, sensor errors found."""
    figure = new_figure(12.0, 9.0)
    figure.set_layout_engine(ConstrainedLayoutEngine(h_pad=0.08, w_pad=0.08, rect=(0.01, 0.01, 0.98, 0.98)))
    mass = calibration.composite.mass
    figure.suptitle(
        f"{calibration.robot}: {mass.value:.2f} +- {mass.half:.2f} kg, the whole robot at its stance",
        fontsize=13,
    )
    grid = figure.add_gridspec(2, 6, height_ratios=[1.0, 1.1])
    for column, (title, which, factor) in enumerate(_GROUPS):
        shown = list(calibration.composite)[which]
        _draw_intervals(figure.add_subplot(grid[0, 2 * column : 2 * column + 2]), shown, title, factor)
    _draw_misfits(figure.add_subplot(grid[1, :3]), calibration)
    _draw_sensors(figure.add_subplot(grid[1, 3:]), calibration)
    return figure


def _draw_intervals(axes: Axes, shown: Sequence[Quantity], title: str, factor: float) -> None:
    for place, quantity in enumerate(shown):
        middle, half = (quantity.value or 0.0) * factor, (quantity.half or 0.0) * factor
        axes.errorbar(place, middle, yerr=half, fmt="o", color=BLUE, capsize=9, markersize=5, linewidth=2, zorder=3)
        label = f"{middle:.3g}\n+- {half:.2g}"
        axes.annotate(
            label, (place, middle + half), (0, 5), textcoords="offset points", fontsize=SMALL, ha="center", va="bottom"
        )
        for value, marker, colour in ((quantity.model, "_", GREY), (quantity.truth, "x", VERMILLION)):
            if value is not None:
                axes.plot(
                    place, value * factor, marker, color=colour, markersize=22 if marker == "_" else 8, mew=2, zorder=4
                )
    axes.plot([], [], "o", color=BLUE, label="found, 95 %")
    axes.plot([], [], "_", color=GREY, mew=2, markersize=12, label="model file")
    if any(quantity.truth is not None for quantity in shown):
        axes.plot([], [], "x", color=VERMILLION, mew=2, label="truth")
    axes.set_xticks(range(len(shown)), [quantity.name for quantity in shown], fontsize=TEXT)
    axes.set_xlim(-0.5, len(shown) - 0.5)
    axes.margins(y=0.25)
    axes.set_title(title, fontsize=TEXT)
    axes.grid(axis="y", color=LIGHT_GREY)
    axes.legend(fontsize=SMALL, frameon=False, loc="best")


def _draw_misfits(axes: Axes, calibration: Calibration) -> None:
    kinds = {"lift": BLUE, "posture": GREEN}
    for kind, colour in kinds.items():
        chosen = [(k, t) for k, t in enumerate(calibration.trials) if t.kind == kind and t.misfit is not None]
        used = [(k, t.misfit or 0.0) for k, t in chosen if t.note is None]
        out = [(k, t.misfit or 0.0) for k, t in chosen if t.note is not None]
        if used:
            axes.bar(*np.transpose(used), color=colour, label="lift" if kind == "lift" else "move over planted feet")
        if out:
            axes.bar(*np.transpose(out), color="white", edgecolor=VERMILLION, hatch="//", label=f"{kind} left out")
    axes.axhline(1.0, color=GREY, linewidth=1, linestyle=(0, (4, 2)))
    axes.set_xlabel("motion", fontsize=TEXT)
    axes.set_ylabel("residual over what noise explains", fontsize=TEXT)
    axes.set_title("How the motions fit", fontsize=TEXT)
    axes.legend(fontsize=SMALL, frameon=False, loc="upper right")
    axes.set_ylim(0, max(2.5, axes.get_ylim()[1] * 1.15))


def _draw_sensors(axes: Axes, calibration: Calibration) -> None:
    shown = [f for f in calibration.sensors if f.name.endswith(" zero") or f.name.startswith("IMU ")]
    shown = sorted(shown, key=lambda finding: -abs(finding.value))[:_SHOWN_BIASES][::-1]
    values = np.degrees([finding.value for finding in shown])
    halves = np.degrees([finding.half for finding in shown])
    colours = [VERMILLION if finding.notable else BLUE for finding in shown]
    axes.barh(range(len(shown)), values, xerr=halves, color=colours, ecolor=GREY, capsize=4)
    axes.set_yticks(range(len(shown)), [finding.name for finding in shown], fontsize=SMALL)
    axes.axvline(0, color=GREY, linewidth=1)
    axes.set_xlabel("off by [deg], 95 %; red: worth fixing", fontsize=TEXT)
    axes.set_title("Largest errors found of joint zeros and IMU mounting", fontsize=TEXT)
    axes.grid(axis="x", color=LIGHT_GREY)
    axes.set_axisbelow(True)
