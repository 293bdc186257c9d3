"""What a run found about motors, for people: a line for each joint, left under right."""

from __future__ import annotations

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from equipoise.result.calibration import Calibration
from equipoise.result.quantity import Quantity

# Name of the quantity, label, factor from SI units, format.
COLUMNS = (
    ("coulomb_friction", "Coulomb [Nm]", 1.0, ".3f"),
    ("viscous_friction", "viscous [Nm s/rad]", 1.0, ".4f"),
    ("armature", "armature [kg m2]", 1.0, ".5f"),
    ("relative_gain", "gain [%]", 100.0, "+.1f"),
    ("delay", "delay [ms]", 1000.0, ".2f"),
)


def print_motors(console: Console, result: Calibration) -> None:
    """Nothing, if the run did not look at motors."""
    if not result.motors:
        return
    table = Table(title=f"{result.robot}: motors, 95 % +-", title_justify="left", box=box.SIMPLE_HEAD)
    table.add_column("joint")
    for _, label, *_ in COLUMNS:
        table.add_column(escape(label), justify="right")
    for joint in left_by_right(result):
        motor = result.motors[joint].quantities
        table.add_row(escape(joint), *(_cell(motor[name], factor, form) for name, _, factor, form in COLUMNS))
    console.print(table)
    console.print(
        "Torques are in the unit in which the motors report them on average; gains are relative to their mean."
    )
    if any(one.missed for motor in result.motors.values() for one in motor.quantities.values()):
        console.print("(!): what was simulated is outside the interval.")


def left_by_right(result: Calibration) -> list[str]:
    """Joints in an order that puts each beside its like on the other side."""
    if result.robot_model is None:
        return list(result.motors)
    legs = [leg.joint_names for leg in result.robot_model.legs.values()]
    pairs = (pair for side in (legs[:2], legs[2:]) for pair in zip(*side, strict=True))
    return [joint for pair in pairs for joint in pair]


def _cell(quantity: Quantity, factor: float, form: str) -> str:
    if quantity.value is None or quantity.half is None:
        return "-"
    outside = " (!)" if quantity.missed else ""
    return f"{quantity.value * factor:{form}} +- {quantity.half * factor:{form.lstrip('+')}}{outside}"
