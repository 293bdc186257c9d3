"""Lifts replayed in simulation: tilt error of each body over time."""

from __future__ import annotations

from equipoise.figures.blocks import DataTable, Figure, PageContents, Trace, axes, pieces, plain
from equipoise.lab.replay.validation import Validation


def validation_table(found: Validation) -> DataTable:
    """Return a row for each body that was replayed."""
    rows = [
        [body, f"{1000 * found.error(body):.2f}", f"{found.ratio(body):.1f}", f"{1000 * found.joint_errors[body]:.1f}"]
        for body in found.bodies
    ]
    return DataTable("", ["body", "|tilt off, rms [mm]", "|times this run's", "|joints off, at most [mrad]"], rows)


def validation_page(found: Validation) -> PageContents:
    """Return table and figure: measured less simulated tilt of each lift, as a distance at the CoM."""
    data: list[Trace] = []
    for series, body in reversed([*enumerate(found.bodies)]):  # this run's on top
        curves = [(lift.seen.time, 1000 * lift.seen.height * lift.errors[body]) for lift in found.lifts]
        data.append(pieces(curves, plain(f"{body}: {1000 * found.error(body):.2f} mm rms"), series))
    title = f"{found.robot}: {len(found.lifts)} lifts replayed"
    layout = axes("time on two feet [s]", "measured less simulated tilt, at the CoM [mm]")
    figure = Figure("Tilt errors", "A line for each lift and body.", data, layout, height=440)
    return PageContents(title, "", f"{found.message}.", [validation_table(found), figure])
