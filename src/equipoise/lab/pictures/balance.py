"""A robot that balances, over time: how it tilts, where its centre of mass is, and what its joints do about it."""

# pyright: reportUnknownMemberType=false
# Matplotlib's own stubs leave **kwargs without a type, which makes every method that takes them partially unknown.

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from equipoise.lab.balance.report import BalanceReport, BalanceTrial
from equipoise.lab.terminal.balance import sentence, title
from equipoise.pictures.figure import (
    BLUE,
    GREEN,
    GREY,
    LIGHT_GREY,
    PURPLE,
    SMALL,
    TEXT,
    VERMILLION,
    new_figure,
)
from equipoise.pictures.files import save_figures

_BEFORE, _AFTER = 0.7, 0.5  # [s] shown around the time on two feet


def draw_balance(report: BalanceReport) -> Figure:
    """One column a diagonal: tilt, distance of the centre of mass from the support line, joint torque."""
    columns = len(report.trials)
    figure = new_figure(6.5 * columns, 8.0)
    figure.set_layout_engine(ConstrainedLayoutEngine(h_pad=0.08, w_pad=0.08, rect=(0.01, 0.01, 0.98, 0.98)))
    figure.suptitle(f"{title(report)}\nthe law believes {report.trials[0].source}", fontsize=12)
    rows = figure.subplots(3, columns, squeeze=False, sharex="col", sharey="row")
    for column, trial in enumerate(report.trials):
        tilt, com, torque = rows[:, column]
        _draw_tilt(tilt, trial)
        _draw_com(com, trial)
        _draw_torque(torque, trial)
        for axes in (tilt, com, torque):
            _mark(axes, trial, named=axes is tilt)
            axes.set_xlim(-_BEFORE, float(trial.run.felt.time[-1]) + _AFTER)
            axes.grid(color=LIGHT_GREY)
            axes.set_axisbelow(True)
        tilt.set_title(sentence(trial), fontsize=TEXT, color=GREEN if trial.verdict.balanced else VERMILLION)
        torque.set_xlabel("time from lift-off [s]", fontsize=TEXT)
    labels = ("tilt of the base [deg]", "CoM ahead of the line [mm]", "joint torques [Nm]")
    for axes, label in zip(rows[:, 0], labels, strict=True):
        axes.set_ylabel(label, fontsize=TEXT)
    rows[0, 0].set_ylim(0, 1.15 * max(np.degrees(trial.verdict.largest_tilt) for trial in report.trials))
    half = 1.15 * max(_largest_distance(trial) for trial in report.trials)
    rows[1, 0].set_ylim(-half, half)
    lines, names = rows[1, 0].get_legend_handles_labels()
    figure.legend(lines, names, loc="outside lower center", ncols=len(lines), fontsize=SMALL, frameon=False)
    return figure


def save_balance_picture(report: BalanceReport, folder: Path) -> Path:
    """Write balance.png; raises OutputError if it cannot be written."""
    return save_figures({"balance.png": draw_balance(report)}, folder)[0]


def _draw_tilt(axes: Axes, trial: BalanceTrial) -> None:
    felt = trial.run.felt
    axes.plot(felt.time, np.degrees(felt.tilt), color=BLUE, linewidth=2.0)
    if trial.verdict.judged_by == "truth":
        axes.plot(trial.traces.time, np.degrees(trial.traces.tilt), "--", color=VERMILLION, linewidth=1.2)


def _draw_com(axes: Axes, trial: BalanceTrial) -> None:
    felt = trial.run.felt
    axes.axhline(0, color=GREY, linewidth=1)
    axes.plot(felt.time, 1000 * felt.com_ahead, color=BLUE, label="as the robot feels it: its CoM is the believed one")
    if trial.verdict.judged_by == "truth":
        axes.plot(trial.traces.time, 1000 * trial.traces.com_ahead, color=VERMILLION, label="as it is")
    if trial.run.observing:
        axes.plot(felt.time, -1000 * felt.offset, color=PURPLE, label="error of the belief, as observed")


def _largest_distance(trial: BalanceTrial) -> float:
    """Of believed and true centre of mass from the line, until it fell [mm]; what a falling robot does is no scale."""
    until = max(trial.verdict.time_balanced, 0.3)
    felt, traces = trial.run.felt, trial.traces
    distances = [felt.com_ahead[felt.time <= until], traces.com_ahead[traces.time <= until]]
    return max(5.0, 1000 * float(np.abs(np.concatenate(distances)).max()))


def _draw_torque(axes: Axes, trial: BalanceTrial) -> None:
    joints = trial.run.recording.joints
    if joints.torque is None:
        axes.text(0.5, 0.5, "this robot reports no torques", transform=axes.transAxes, ha="center", fontsize=TEXT)
        return
    time = joints.time - trial.run.lift_off
    shown = (time >= -_BEFORE) & (time <= float(trial.run.felt.time[-1]) + _AFTER)
    for index in range(joints.torque.shape[1]):
        axes.plot(time[shown], joints.torque[shown, index], color=GREY, linewidth=0.5, alpha=0.5)


def _mark(axes: Axes, trial: BalanceTrial, named: bool) -> None:
    marks = [("lift-off", 0.0, GREEN)]
    if not trial.verdict.balanced:
        marks.append(("fall", trial.verdict.time_balanced, VERMILLION))
    for name, moment, colour in marks:
        axes.axvline(moment, color=colour, linewidth=1.5, linestyle=(0, (4, 2)))
        if named:
            axes.annotate(
                name, (moment, 1), (-3, -4), xycoords=("data", "axes fraction"), textcoords="offset points", rotation=90,
                va="top", ha="right", fontsize=SMALL, color=colour,
            )  # fmt: skip
