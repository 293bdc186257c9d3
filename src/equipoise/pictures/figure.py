"""What the pictures share: figures without pyplot, and colours that everybody can tell apart."""

# pyright: reportUnknownMemberType=false
# Matplotlib's own stubs leave **kwargs without a type, which makes every method that takes them partially unknown.

from __future__ import annotations

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

DPI = 150
# Okabe and Ito's palette, which readers with any colour vision can tell apart.
BLACK, BLUE, VERMILLION, GREEN, PURPLE = "#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7"
GREY, LIGHT_GREY = "#595959", "#D9D9D9"
TEXT, SMALL = 10, 9  # font sizes


def new_figure(width: float, height: float) -> Figure:
    """A white figure of a size in inches, with a canvas of its own."""
    figure = Figure(figsize=(width, height), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    return figure
