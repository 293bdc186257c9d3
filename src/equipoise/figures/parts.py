"""Tables of estimated properties of motors and links."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import floor, log10

from equipoise.figures.blocks import DataTable, number
from equipoise.result.calibration import Calibration
from equipoise.result.findings import Link, Part
from equipoise.result.legend import verdict_message
from equipoise.result.quantity import Quantity
from equipoise.result.shown import Shown

_MOTORS = (
    Shown("coulomb_friction", "Coulomb [Nm]", 1.0, "", "Coulomb friction"),
    Shown("viscous_friction", "viscous [mNm s/rad]", 1000.0, "", "viscous friction"),
    Shown("stribeck_friction", "Stribeck [Nm]", 1.0, "", "Stribeck friction"),
    Shown("armature", "armature [g m2]", 1000.0, "", "armature"),
    Shown("relative_gain", "gain [%]", 100.0, "+", "relative torque gain"),
    Shown("delay", "delay [ms]", 1000.0, "", "position-loop delay"),
)
_LINKS = (
    Shown("mass", "mass [g]", 1000.0, "", "mass"),
    Shown("moment_x", "m cx [g m]", 1000.0, "+", "first moment along x"),
    Shown("moment_y", "m cy [g m]", 1000.0, "+", "first moment along y"),
    Shown("moment_z", "m cz [g m]", 1000.0, "+", "first moment along z"),
    Shown("length", "length [mm]", 1000.0, "", "length"),
)

_VERDICTS = {"not identified": "In brackets: not identified, posterior std above half of the prior std"}


@dataclass(frozen=True, eq=False)
class Parts:
    """All parts of one kind.

    Attributes:
        kind: "motors" or "links".
        each: noun for the name of a part, "joint" or "link".
        columns: quantities to show.
        found: parts by name; each left one is followed by its right counterpart.
        remark: units and reference of the numbers.
    """

    kind: str
    each: str
    columns: tuple[Shown, ...]
    found: Mapping[str, Part]
    remark: str

    @property
    def legend(self) -> str:
        """Explanation of the marks in the table; empty without any."""
        return verdict_message((one for part in self.found.values() for one in part.quantities.values()), _VERDICTS)

    def of(self, name: str) -> list[Quantity]:
        """Return one quantity of every part."""
        return [part.quantities[name] for part in self.found.values()]

    @property
    def has_truth(self) -> bool:
        """True if the ground truth is known."""
        return any(quantity.truth is not None for one in self.columns for quantity in self.of(one.name))

    def table(self, title: str = "", truth: bool = False) -> DataTable:
        """Return a table with a row for each part.

        Args:
            truth: true for the ground truth, with the digits of the estimates.
        """
        columns = [_cells(self.of(one.name), one, truth) for one in self.columns]
        rows = [list(row) for row in zip(self.found, *columns, strict=True)]
        heads = [self.each, *(f"|{one.label}" for one in self.columns)]
        words = f"Each {self.each} with the half width of its 95 % interval; left above right. {self.legend}"
        return DataTable(title or words.rstrip(), heads, rows)


def motors_alone(result: Calibration) -> bool:
    """Return whether the run estimated motors and nothing else."""
    return bool(result.motors) and all(quantity.value is None for quantity in result.composite)


def parts_of(result: Calibration) -> list[Parts]:
    """Return motors and links, if the run estimated them."""
    joints = list(result.motors)
    if result.robot_model is not None:
        joints = [name for leg in result.robot_model.legs.values() for name in leg.joint_names]
    motors = Parts(
        "motors", "joint", _with_values(_MOTORS, result.motors), _left_by_right(result.motors, joints),
        "Torques have the mean scale of the torques that the motors report; gains are relative to their mean.",
    )  # fmt: skip
    return [parts for parts in (motors, parts_of_legs(result.links)) if parts.found]


def _with_values(columns: tuple[Shown, ...], found: Mapping[str, Part]) -> tuple[Shown, ...]:
    """Return the columns with at least one value; Stribeck friction often has none."""
    return tuple(one for one in columns if any(part.quantities[one.name].value is not None for part in found.values()))


def parts_of_legs(links: Mapping[str, Link]) -> Parts:
    """Return the parts of links, given by name, leg by leg."""
    return Parts(
        "links", "link", _LINKS, _left_by_right(links, list(links)),
        "Each link with everything fixed to it, in its joint's frame. m c is the first moment, mass times CoM position, which "
        "motions determine better than the mass. Lengths are from joint to joint; a calf's is to the foot centre.",
    )  # fmt: skip


def _left_by_right(found: Mapping[str, Part], names: Sequence[str]) -> dict[str, Part]:
    """Return parts with each right one after its left counterpart; `names` are in leg order FL FR RL RR."""
    per_leg = len(names) // 4
    sides = (names[: 2 * per_leg], names[2 * per_leg :])
    pairs = (pair for side in sides for pair in zip(side[:per_leg], side[per_leg:], strict=True))
    return {name: found[name] for pair in pairs for name in pair if name in found}


def _cells(quantities: list[Quantity], shown: Shown, truth: bool) -> list[str]:
    """Return the cells of a column, with the digits of its narrowest interval."""
    half_widths = [quantity.half_width * shown.factor for quantity in quantities if quantity.half_width]
    form = f".{_decimals(min(half_widths, default=1.0))}f"
    if truth:
        return [number(quantity.truth, shown.factor, shown.form + form) for quantity in quantities]
    return [_cell(quantity, shown, form) for quantity in quantities]


def _decimals(half: float) -> int:
    """Return the decimals for a half width: its first significant digit, and its second if the first is 1 or 2."""
    place = floor(log10(half))
    return max(0, -place + (half < 3 * 10.0**place))


def _cell(quantity: Quantity, shown: Shown, form: str) -> str:
    if quantity.value is None or quantity.half_width is None:
        return "-"
    outside = " (!)" if quantity.missed else ""
    value, half = quantity.value * shown.factor, quantity.half_width * shown.factor
    text = f"{value:{shown.form}{form}}+-{half:{form}}"
    return f"({text}){outside}" if quantity.verdict == "not identified" else text + outside
