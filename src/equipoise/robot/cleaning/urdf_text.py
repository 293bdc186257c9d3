"""Numbers and elements of URDF text."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from equipoise.errors import ModelError


def tidy_vector(element: ET.Element | None, key: str, what: str, path: Path) -> None:
    """Write three numbers separated by one space, as urdfdom requires; refuse any other number of them."""
    if element is None or (text := element.get(key)) is None:
        return
    words = text.split()
    for word in words:
        number(word, 0.0, what, path)
    if len(words) != 3:
        raise ModelError(f"robot model {str(path)!r}: {what} is {text!r}; it must be three numbers")
    element.set(key, " ".join(words))


def number(text: str | None, default: float, what: str, path: Path) -> float:
    """Read a number, or the default if there is none; refuse text that is not a number."""
    if text is None:
        return default
    try:
        return float(text)
    except ValueError:
        remedy = "; write decimals with a point" if "," in text else ""
        raise ModelError(f"robot model {str(path)!r}: {what} is {text!r}, which is not a number{remedy}") from None


def words(numbers: NDArray[np.float64]) -> str:
    """Write numbers with all their digits."""
    return " ".join(repr(float(number)) for number in numbers)


def child(element: ET.Element, tag: str) -> ET.Element:
    """Return the first child with a tag, made if there is none."""
    found = element.find(tag)
    return ET.SubElement(element, tag) if found is None else found
