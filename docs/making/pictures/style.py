"""What the site's pictures share: one look, and colours that follow the page from light to dark."""

import io
import re
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Wedge

FOLDER = Path(__file__).parents[2] / "pictures"
INK, MUTED, FAINT, PAPER = "#1b2a33", "#66757f", "#d3dade", "#fdfcf9"
BLUE, ORANGE, GREEN = "#1a6a9c", "#cf4f16", "#2b8764"
# In a page its style sheet sets these; in an image of its own the reader's system chooses.
_NAMES = {INK: "ink", MUTED: "muted", FAINT: "faint", PAPER: "paper", BLUE: "blue", ORANGE: "orange", GREEN: "green"}
_DARK = {INK: "#dbe3e7", MUTED: "#93a3ad", FAINT: "#38474f", PAPER: "#12191d", BLUE: "#62b3e0", ORANGE: "#f2864f",
         GREEN: "#5fc49b"}  # fmt: skip

matplotlib.rcParams.update(
    {
        "svg.fonttype": "none", "svg.hashsalt": "equipoise", "font.size": 10, "text.color": INK, "axes.edgecolor": MUTED,
        "axes.labelcolor": INK, "axes.titlesize": 10.5, "axes.titleweight": "bold", "axes.titlelocation": "left",
        "axes.spines.top": False, "axes.spines.right": False, "axes.facecolor": "none", "axes.linewidth": 0.8,
        "xtick.color": MUTED, "ytick.color": MUTED, "xtick.labelsize": 9, "ytick.labelsize": 9, "grid.color": FAINT,
        "grid.linewidth": 0.7, "axes.axisbelow": True, "lines.linewidth": 1.8, "lines.solid_capstyle": "round",
        "legend.frameon": False, "legend.fontsize": 9, "legend.labelcolor": INK,
    }
)  # fmt: skip


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of a size in inches."""
    return Figure(figsize=(width, height), layout="constrained", facecolor="none")


def bare(axes: Axes) -> Axes:
    """Axes as a sheet of paper: equal scales, nothing drawn around it."""
    axes.set_aspect("equal")
    axes.set_axis_off()
    return axes


def draw_com(axes: Axes, x: float, y: float, radius: float) -> None:
    """The draughtsman's mark of a centre of mass."""
    axes.add_patch(Circle((x, y), radius, facecolor=PAPER, edgecolor=ORANGE, linewidth=1.4, zorder=9))
    for start in (0, 180):
        axes.add_patch(Wedge((x, y), radius, start, start + 90, facecolor=ORANGE, linewidth=0, zorder=9.1))


def save(figure: Figure, name: str) -> Path:
    """Write a picture; colours become the page's."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    svg = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->", "", buffer.getvalue(), flags=re.DOTALL)
    svg = re.sub(r"font: (?:\w+ )?([\d.]+px) [^;\"]*", r"font-size: \1", svg)
    svg = re.sub(r"font-family: [^;\"]*;? ?", "", svg)
    for colour, word in _NAMES.items():
        svg = svg.replace(colour, f"var(--picture-{word})")
    light, dark = (
        " ".join(f"--picture-{word}: {colours.get(colour, colour)};" for colour, word in _NAMES.items())
        for colours in ({}, _DARK)
    )
    style = f":root {{ {light} }} @media (prefers-color-scheme: dark) {{ :root {{ {dark} }} }}"
    style += " text { font-family: system-ui, sans-serif; }"
    svg = re.sub(r"(<svg [^>]*>)", rf"\1<style>{style}</style>", svg, count=1)
    svg = "\n".join(line.rstrip() for line in svg.splitlines() if line.strip()) + "\n"
    FOLDER.mkdir(exist_ok=True)
    path = FOLDER / f"{name}.svg"
    path.write_text(svg, encoding="utf-8")
    return path


def turned(points: np.ndarray, azimuth: float, elevation: float) -> np.ndarray:
    """(n, 2) of (n, 3) points as seen from a direction [deg]."""
    a, e = np.radians([azimuth, elevation])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    up = np.array([-np.sin(e) * np.cos(a), -np.sin(e) * np.sin(a), np.cos(e)])
    return np.atleast_2d(points) @ np.array([right, up]).T
