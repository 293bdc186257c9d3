"""Lifts replayed in simulation: tilt error of each body over time."""

from __future__ import annotations

from equipoise.figures.blocks import DataTable, Figure, PageContents, Trace, axes, pieces, plain
from equipoise.lab.replay.validation import Validation


def validation_table(done: Validation) -> DataTable:
    """Return a row for each replayed body."""
    rows = [
        [body, f"{1000 * done.error(body):.2f}", f"{done.ratio(body):.1f}", f"{1000 * done.joint_errors[body]:.1f}"]
        for body in done.bodies
    ]
    return DataTable("", ["body", "|tilt error, rms [mm]", "|ratio to this run", "|largest joint error [mrad]"], rows)


def validation_page(done: Validation) -> PageContents:
    """Return table and figure: measured minus simulated tilt of each lift, as a distance at the CoM."""
    data: list[Trace] = []
    for series, body in reversed([*enumerate(done.bodies)]):  # this run's on top
        curves = [(lift.measured.time, 1000 * lift.measured.height * lift.errors[body]) for lift in done.lifts]
        data.append(pieces(curves, plain(f"{body}: {1000 * done.error(body):.2f} mm rms"), series))
    title = f"{done.robot}: {len(done.lifts)} lifts replayed"
    layout = axes("time on two feet [s]", "measured minus simulated tilt, at the CoM [mm]")
    figure = Figure("Tilt errors", "A line for each lift and body.", data, layout, height=440)
    return PageContents(title, "", f"{done.message}.", [validation_table(done), figure])
