"""Labels, units and digits of numbers in tables."""

from __future__ import annotations

from typing import NamedTuple

from equipoise.conventions import AXES


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
    Shown("mass", "mass [kg]", 1.0, ".3f", "mass"),
    Shown("com_x", "CoM x [mm]", 1000.0, ".2f", "CoM x"),
    Shown("com_y", "CoM y [mm]", 1000.0, ".2f", "CoM y"),
    Shown("com_z", "CoM z [mm]", 1000.0, ".2f", "CoM z"),
    *(Shown(name, f"{name} [kg m2]", 1.0, ".4f", name) for name in ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")),
)
"""Display formats of a body's quantities, in their order."""
_LETTERS = dict(zip("xyz", AXES, strict=True))
_PAPER = (
    *(Shown(f"I_{letter}", f"I_{letter} ({axis}) [kg m2]", 1.0, ".4f") for letter, axis in _LETTERS.items()),
    *(Shown(f"C_{letter}", f"C_{letter} ({axis}) [Nm s/rad]", 1.0, ".3f") for letter, axis in _LETTERS.items()),
)
SHOWN = {row.name: row for row in (*ROWS, *_PAPER)}
"""Display formats of a body's quantities and of the paper's I and C, by name."""


def called(name: str) -> str:
    """Return the name of a body's quantity in a sentence: "CoM x" for com_x."""
    return SHOWN[name].words
