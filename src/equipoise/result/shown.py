"""How people read a body's numbers: labels, units and digits."""

from __future__ import annotations

from typing import NamedTuple


class Shown(NamedTuple):
    """One number of a body, as tables show it.

    Attributes:
        name: name of the quantity.
        label: what it is called, with its unit.
        factor: from the SI unit to the one that is shown.
        form: format of the number.
    """

    name: str
    label: str
    factor: float
    form: str


ROWS = (
    Shown("mass", "mass [kg]", 1.0, ".3f"),
    Shown("com_x", "CoM x [mm]", 1000.0, ".2f"),
    Shown("com_y", "CoM y [mm]", 1000.0, ".2f"),
    Shown("com_z", "CoM z [mm]", 1000.0, ".2f"),
    *(Shown(name, f"{name} [kg m2]", 1.0, ".4f") for name in ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")),
)
"""In the order of a body's quantities."""
