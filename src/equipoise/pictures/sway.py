"""The sways: measured and fitted angular velocity, torque against fit."""

# pyright: reportUnknownMemberType=false
# Matplotlib's own stubs leave **kwargs without a type, which makes every method that takes them partially unknown.

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D

from equipoise.conventions import AXES, Axis
from equipoise.paper.equations import AxisFit
from equipoise.paper.evidence import SwayEvidence
from equipoise.pictures.figure import (
    BLACK,
    BLUE,
    GREY,
    LIGHT_GREY,
    SMALL,
    TEXT,
    evidence_of,
    new_figure,
)
from equipoise.result.calibration import Calibration

_MEASURED: Mapping[str, Any] = {"color": BLUE, "linewidth": 2.4, "alpha": 0.75, "label": "measured"}
_FITTED: Mapping[str, Any] = {"color": BLACK, "linewidth": 1.3, "linestyle": (0, (4, 2)), "label": "fitted"}


def draw_sways(calibration: Calibration) -> Figure:
    """Angular velocity, and torque about the CoM, of each sway, with the sinusoid and the torque fitted to them.

    An axis without an estimate gets a panel that says why.

    Raises:
        NotEstimatedError: the calibration came from a JSON file.
    """
    fits = evidence_of(calibration, SwayEvidence).fits
    heights = [1.0 if axis in fits else 0.45 for axis in AXES]
    figure = new_figure(11.5, 1.0 + 2.8 * sum(heights))
    figure.set_layout_engine(ConstrainedLayoutEngine(h_pad=0.08, rect=(0.01, 0.01, 0.98, 0.98)))
    feet = f", feet {calibration.feet}" if calibration.feet else ""
    title = f"Sways of {calibration.robot}: method {calibration.method}{feet}"
    figure.suptitle(textwrap.fill(title, 95), fontsize=13)
    grid = figure.add_gridspec(len(AXES), 2, height_ratios=heights)
    for row, axis in enumerate(AXES):
        fit, note = fits.get(axis), calibration.sways[axis].note
        if fit is None:
            _draw_skipped(figure.add_subplot(grid[row, :]), axis, note or "no reason is known")
        else:
            _draw_fit((figure.add_subplot(grid[row, 0]), figure.add_subplot(grid[row, 1])), fit, note)
    handles = [Line2D([], [], **_MEASURED), Line2D([], [], **_FITTED)]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, fontsize=TEXT, frameon=False)
    return figure


def _draw_fit(panels: tuple[Axes, Axes], fit: AxisFit, note: str | None) -> None:
    """One axis: what the gyroscope and the joint torques said, and what was fitted to it."""
    title = (
        f"{fit.axis}:  I = {fit.inertia:.4g} kg m\u00b2,  C = {fit.damping:.3g} N m s/rad,  "
        f"frequency = {fit.sinusoid.frequency:.3f} Hz"
    )
    panels[0].set_title(_with_note(title, note), loc="left", fontsize=TEXT + 1)
    contents = (
        ("angular velocity [rad/s]", fit.angular_velocity, fit.sinusoid.value(fit.time)),
        ("torque [N m]", fit.torque, fit.fitted_torque),
    )
    for axes, (label, measured, fitted) in zip(panels, contents, strict=True):
        axes.plot(fit.time, measured, **_MEASURED)
        axes.plot(fit.time, fitted, **_FITTED)
        axes.set_xlim(0.0, float(fit.time[-1]))
        axes.set_xlabel("time [s]", fontsize=TEXT)
        axes.set_ylabel(label, fontsize=TEXT)
        axes.tick_params(labelsize=SMALL)
        axes.grid(color=LIGHT_GREY, linewidth=0.6)


def _with_note(title: str, note: str | None) -> str:
    return title if note is None else f"{title}\n{textwrap.fill(note, 120)}"


def _draw_skipped(axes: Axes, axis: Axis, reason: str) -> None:
    """An empty panel with the reason in it."""
    axes.set_title(f"{axis}:  no estimate", loc="left", fontsize=TEXT + 1)
    axes.set_xticks([])
    axes.set_yticks([])
    axes.set_facecolor("#F6F6F6")
    for spine in axes.spines.values():
        spine.set_color(LIGHT_GREY)
    wrapped = textwrap.fill(reason, 80)
    axes.text(0.5, 0.5, wrapped, transform=axes.transAxes, ha="center", va="center", fontsize=TEXT + 1, color=GREY)
