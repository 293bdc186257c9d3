"""What people see in the terminal of a robot that balances."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from equipoise.lab.balance.report import BalanceReport, BalanceTrial
from equipoise.terminal.calibration import number


def print_balance(report: BalanceReport, files: Sequence[Path]) -> None:
    """One column a diagonal, and the verdict in words."""
    console = Console()
    table = Table(title=escape(title(report)), title_justify="left", box=box.SIMPLE_HEAD)
    table.add_column("")
    for trial in report.trials:
        table.add_column(trial.run.diagonal, justify="right")
    for label, *cells in _rows(report):
        table.add_row(escape(label), *cells)
    console.print(table)
    for trial in report.trials:
        console.print(sentence(trial))
    known = "taken off, as calibrated" if report.sensors_known else "not known to the law"
    console.print(f"The law believes {escape(report.trials[0].source)}; sensor errors are {known}.")
    if report.settings.observe_offset:
        console.print(
            "The offset of the centre of mass was observed and made up for: a measurement, no proof of the model."
        )
    console.print("saved: " + escape(", ".join(str(file) for file in files)), soft_wrap=True)


def title(report: BalanceReport) -> str:
    """Of table and picture."""
    mode = "observing the offset of its centre of mass" if report.settings.observe_offset else "with a fixed model"
    return f"{report.robot}: balancing on two feet {mode}"


def sentence(trial: BalanceTrial) -> str:
    """The verdict of one diagonal."""
    verdict = trial.verdict
    if verdict.balanced:
        return f"{trial.run.diagonal}: balanced for {verdict.time_balanced:.1f} s"
    return f"{trial.run.diagonal}: fell after {verdict.time_balanced:.2f} s, {verdict.failure}"


def _rows(report: BalanceReport) -> list[list[str]]:
    verdicts = [trial.verdict for trial in report.trials]
    rows = [
        ["time balanced [s]", *(f"{v.time_balanced:.2f}" for v in verdicts)],
        ["sway of the CoM about its mean, rms [mm]", *(number(v.sway, 1000, ".2f") for v in verdicts)],
        ["CoM in front of the line, mean [mm]", *(number(v.off_line, 1000, "+.2f") for v in verdicts)],
        ["tilt of the base, last second [deg]", *(number(np.degrees(v.tilt), 1, ".1f") for v in verdicts)],
        ["largest tilt [deg]", *(number(np.degrees(v.largest_tilt), 1, ".1f") for v in verdicts)],
        ["largest joint torque [Nm]", *(number(v.largest_torque, 1, ".1f") for v in verdicts)],
        ["joint torque, rms [Nm]", *(number(v.rms_torque, 1, ".2f") for v in verdicts)],
    ]
    if any(trial.believed_error is not None for trial in report.trials):
        errors = [number(trial.believed_error, 1000, "+.2f") for trial in report.trials]
        rows.append(["believed CoM in front of the true one [mm]", *errors])
    if report.settings.observe_offset:
        rows.append(["the same, as observed [mm]", *(number(v.observed_error, 1000, "+.2f") for v in verdicts)])
    return rows
