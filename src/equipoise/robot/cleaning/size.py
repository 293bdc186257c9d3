"""Size limits of model files."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from equipoise.errors import ModelError

_MOST_LINKS = 5000  # about five seconds
_DEEPEST = 200  # elements within elements


def refuse_immense(root: ET.Element, path: Path) -> None:
    """Refuse a huge model, because reading time grows with the square of the number of links; raises ModelError."""
    links = sum(element.tag in ("link", "body") for element in root.iter())
    if links > _MOST_LINKS:
        raise ModelError(
            f"robot model {str(path)!r} has {links} links; up to {_MOST_LINKS} are read: give the file of one robot, without "
            "its surroundings"
        )
    level, depth = [root], 0
    while level := [child for element in level for child in element]:
        depth += 1
        if depth > _DEEPEST:
            raise ModelError(
                f"robot model {str(path)!r} is nested more than {_DEEPEST} deep; it is damaged, or not of a quadruped"
            )
