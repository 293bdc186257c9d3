"""One set of colours for the page and for Rerun."""

from __future__ import annotations

from equipoise.figures.geometry import Part

Colour = tuple[int, int, int]

COLOURS: dict[Part, Colour] = {
    "base": (70, 86, 112),
    "hip": (92, 108, 134),
    "thigh": (148, 162, 184),
    "shank": (192, 202, 216),
}
CONTACT, IN_AIR, LINE, COM = (46, 160, 90), (170, 176, 186), (240, 140, 20), (214, 51, 108)
VERDICTS: dict[str | None, Colour] = {
    "forward": (47, 126, 216), "backward": (232, 116, 59), "balanced": (58, 166, 85), None: (122, 135, 148),
}  # fmt: skip
"""Of what a lift said: which way the robot tipped; None: the plane holds the CoM."""
MAGNIFIED = 10.0
"""Factor that the CoM's ellipsoid is drawn with: a fraction of a millimetre could not be seen."""


def html(colour: Colour) -> str:
    """As pages write it."""
    return "#{:02x}{:02x}{:02x}".format(*colour)
