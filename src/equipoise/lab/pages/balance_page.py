"""Page of a balance report: tilt, distance of the CoM from the support line and joint torques over time."""

from __future__ import annotations

import numpy as np

from equipoise.figures.blocks import (
    MUTED,
    SERIES,
    DataTable,
    Figure,
    PageContents,
    Trace,
    axes,
    line,
    number,
    upright,
)
from equipoise.lab.balance.balance_report import BalanceReport, BalanceTrial

_BEFORE, _AFTER = 0.7, 0.5  # [s] shown around the time on two feet


def balance_table(report: BalanceReport) -> DataTable:
    """Return a column for each diagonal."""
    verdicts = [trial.verdict for trial in report.trials]
    rows = [
        ["time balanced [s]", *(f"{v.time_balanced:.2f}" for v in verdicts)],
        ["CoM across the line, std [mm]", *(number(v.com_std, 1000, ".2f") for v in verdicts)],
        ["CoM in front of the line, mean [mm]", *(number(v.off_line, 1000, "+.2f") for v in verdicts)],
        ["tilt of the base, last second [deg]", *(number(np.degrees(v.tilt), 1, ".1f") for v in verdicts)],
        ["largest tilt [deg]", *(number(np.degrees(v.largest_tilt), 1, ".1f") for v in verdicts)],
        ["largest joint torque [Nm]", *(number(v.largest_torque, 1, ".1f") for v in verdicts)],
        ["joint torque, rms [Nm]", *(number(v.rms_torque, 1, ".2f") for v in verdicts)],
        ["model's CoM in front of the true one [mm]", *(number(t.model_error, 1000, "+.2f") for t in report.trials)],
    ]
    return DataTable("", ["", *(f"|{trial.run.diagonal}" for trial in report.trials)], rows)


def title(report: BalanceReport) -> str:
    """Return the heading of table and page."""
    return f"{report.robot}: balancing on two feet with a fixed model"


def messages(report: BalanceReport) -> tuple[str, ...]:
    """Return the verdict of each diagonal, and the design of the controller."""
    verdicts = [f"{trial.run.diagonal}: {_verdict(trial)}" for trial in report.trials]
    correction = "corrected as calibrated" if report.sensors_corrected else "not corrected"
    used = f"The controller is designed on {report.trials[0].source}; sensor errors are {correction}."
    return (*verdicts, used)


def _verdict(trial: BalanceTrial) -> str:
    verdict = trial.verdict
    if verdict.balanced:
        return f"balanced for {verdict.time_balanced:.1f} s"
    return f"fell after {verdict.time_balanced:.2f} s, {verdict.failure}"


def balance_page(report: BalanceReport) -> PageContents:
    """Return table, verdicts, and three figures for each diagonal."""
    sections = {f"On {trial.run.diagonal}": [_tilt(trial), _com(trial), _torque(trial)] for trial in report.trials}
    return PageContents(title(report), "", "", [balance_table(report), *messages(report)], sections)


def _figure(trial: BalanceTrial, name: str, caption: str, data: list[Trace], label: str) -> Figure:
    """Return a figure over time from lift-off, with marks where the feet left the floor and where the robot fell."""
    marks = [upright(0.0, "lift-off", SERIES[2])]
    if not trial.verdict.balanced:
        marks.append(upright(trial.verdict.time_balanced, "fall", SERIES[1]))
    layout = axes("time from lift-off [s]", label, shapes=marks)
    layout["xaxis"]["range"] = [-_BEFORE, float(trial.run.estimates.time[-1]) + _AFTER]
    return Figure(name, caption, data, layout)


def _tilt(trial: BalanceTrial) -> Figure:
    estimates, traces = trial.run.estimates, trial.traces
    data = [
        line(estimates.time, np.degrees(estimates.tilt), "measured", 0),
        line(traces.time, np.degrees(traces.tilt), "true", 1),
    ]
    figure = _figure(trial, "Tilt of the base", _verdict(trial), data, "tilt [deg]")
    figure.layout["yaxis"]["range"] = [0, 1.15 * float(np.degrees(trial.verdict.largest_tilt))]
    return figure


def _com(trial: BalanceTrial) -> Figure:
    estimates, traces = trial.run.estimates, trial.traces
    data = [
        line(estimates.time, 1000 * estimates.com_ahead, "measured, with the model's CoM", 0),
        line(traces.time, 1000 * traces.com_ahead, "true", 1),
    ]
    limit = 1.15 * _largest_distance(trial)
    caption = "Distance of the centre of mass from the support line, forward positive."
    figure = _figure(trial, "Centre of mass", caption, data, "CoM ahead of the line [mm]")
    figure.layout["yaxis"]["range"] = [-limit, limit]
    return figure


def _largest_distance(trial: BalanceTrial) -> float:
    """Return the largest distance of the CoM from the line before the fall [mm]."""
    until = max(trial.verdict.time_balanced, 0.3)
    estimates, traces = trial.run.estimates, trial.traces
    distances = [estimates.com_ahead[estimates.time <= until], traces.com_ahead[traces.time <= until]]
    return max(5.0, 1000 * float(np.abs(np.concatenate(distances)).max()))


def _torque(trial: BalanceTrial) -> Figure:
    joints, data = trial.run.recording.joints, list[Trace]()
    if joints.torque is not None:
        time = joints.time - trial.run.lift_off
        shown = (time >= -_BEFORE) & (time <= float(trial.run.estimates.time[-1]) + _AFTER)
        style = {"color": MUTED, "width": 0.5, "dash": "solid"}
        data = [line(time[shown], one, "joint", 0, line=style, showlegend=False) for one in joints.torque[shown].T]
    caption = "A line for each joint." if data else "This robot reports no torques."
    return _figure(trial, "Joint torques", caption, data, "torque [Nm]")
