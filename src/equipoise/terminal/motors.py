"""What a run found about motors, for people: a line for each joint, left under right."""

from __future__ import annotations

from math import floor, log10

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from equipoise.result.calibration import Calibration
from equipoise.result.quantity import Quantity

# Name of the quantity, label, factor from SI units, sign of the format, what it is in words.
COLUMNS = (
    ("coulomb_friction", "Coulomb [Nm]", 1.0, "", "Coulomb friction"),
    ("viscous_friction", "viscous [mNm s/rad]", 1000.0, "", "viscous friction"),
    ("armature", "armature [g m2]", 1000.0, "", "armature"),
    ("relative_gain", "gain [%]", 100.0, "+", "relative torque gain"),
    ("delay", "delay [ms]", 1000.0, "", "position-loop delay"),
)
UNITS = "Torques are in the unit in which the motors report them on average; gains are relative to their mean."


def print_motors(console: Console, result: Calibration) -> None:
    """Nothing, if the run did not look at motors."""
    if not result.motors:
        return
    table = Table(
        title=f"{result.robot}: motors, 95 % +-", title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1)
    )
    table.add_column("joint", overflow="fold")
    for _, label, *_ in COLUMNS:
        table.add_column(escape(label.replace(" [", "\n[")), justify="right", no_wrap=True)
    for joint, *cells in motor_rows(result):
        table.add_row(escape(joint), *cells)
    console.print(table)
    console.print(UNITS)
    if any(one.missed for motor in result.motors.values() for one in motor.quantities.values()):
        console.print("(!): what was simulated is outside the interval.")


def motor_rows(result: Calibration, plus_minus: str = "+-") -> list[list[str]]:
    """Of each joint its name and what was found, as of `COLUMNS`."""
    joints, columns = left_by_right(result), list[list[str]]()
    for name, _, factor, sign, _ in COLUMNS:
        quantities = [result.motors[joint].quantities[name] for joint in joints]
        columns.append(_cells(quantities, factor, sign, f" {plus_minus} "))
    return [list(row) for row in zip(joints, *columns, strict=True)]


def left_by_right(result: Calibration) -> list[str]:
    """Joints in an order that puts each beside its like on the other side."""
    if result.robot_model is None:
        return list(result.motors)
    legs = [leg.joint_names for leg in result.robot_model.legs.values()]
    pairs = (pair for side in (legs[:2], legs[2:]) for pair in zip(*side, strict=True))
    return [joint for pair in pairs for joint in pair]


def _cells(quantities: list[Quantity], factor: float, sign: str, plus_minus: str) -> list[str]:
    """A column; the narrowest interval says how many digits all have."""
    halves = [quantity.half * factor for quantity in quantities if quantity.half]
    form = f".{_decimals(min(halves, default=1.0))}f"
    return [_cell(quantity, factor, sign, form, plus_minus) for quantity in quantities]


def _decimals(half: float) -> int:
    """Of a number whose interval is that wide to each side: its first digit, and the second of what begins with 1 or 2."""
    place = floor(log10(half))
    return max(0, -place + (half < 3 * 10.0**place))


def _cell(quantity: Quantity, factor: float, sign: str, form: str, plus_minus: str) -> str:
    if quantity.value is None or quantity.half is None:
        return "-"
    outside = " (!)" if quantity.missed else ""
    return f"{quantity.value * factor:{sign}{form}}{plus_minus}{quantity.half * factor:{form}}{outside}"
