"""Labels, units and digits of numbers in tables."""

from __future__ import annotations

from typing import NamedTuple


class Shown(NamedTuple):
    """Display format of one quantity.

    Attributes:
        name: name of the quantity.
        label: name with the displayed unit.
        factor: conversion factor from the SI unit to the displayed unit.
        form: format specification of the number.
        words: name within a sentence.
    """

    name: str
    label: str
    factor: float
    form: str
    words: str = ""


ROWS = (
    ("mass", "mass [kg]", 1.0, ".3f"),
    ("com_x", "CoM x [mm]", 1000.0, ".2f"),
    ("com_y", "CoM y [mm]", 1000.0, ".2f"),
    ("com_z", "CoM z [mm]", 1000.0, ".2f"),
    *((name, f"{name} [kg m2]", 1.0, ".4f") for name in ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")),
)
"""Name, label, factor and format of a body's quantities, in their order."""


def called(name: str) -> str:
    """Return the name of a body's quantity in a sentence: "CoM x" for com_x."""
    return next(shown[1].split(" [")[0] for shown in ROWS if shown[0] == name)
