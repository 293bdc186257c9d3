"""Tables, figures and texts of results, which `terminal` and `report` render.

Text is ASCII. The HTML report typesets "+-" and minus signs. Figures are Plotly figures as plain dictionaries.
"""

from __future__ import annotations

import html
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # lists of robots and formats load no NumPy
    from equipoise.conventions import FloatArray
    from equipoise.result.quantity import Quantity

Trace = dict[str, Any]
"""Plotly trace or layout."""

SERIES = ("#0b62a4", "#c2500a", "#00806a", "#a04a86")
DASHES = ("solid", "dash", "dot", "dashdot")
"""Dashes of the series, so that lines differ not only in colour."""
INK, MUTED, ROBOT = "#1b1f24", "#5b6570", "#8b95a1"
BAR = "interval"
"""Heading of the column of interval bars."""
LONG = 24
"""Number of characters above which a cell may wrap."""


@dataclass(frozen=True)
class Cell:
    """A cell of a table.

    Attributes:
        text: text of the cell.
        tone: "strong", "muted" or "bad".
        verdict: verdict, which the report shows with a sign and a colour.
        bar: quantity whose interval is drawn; the terminal omits it.
    """

    text: str = ""
    tone: str = ""
    verdict: str = ""
    bar: Quantity | None = None

    def __str__(self) -> str:
        return " ".join(filter(None, (self.text, self.verdict)))


@dataclass(frozen=True)
class DataTable:
    """A table.

    Attributes:
        title: caption.
        columns: headings; columns with a leading "|" are right-aligned.
        rows: cells.
        folded: True if the report shows the rows on demand.
        style: CSS class, "numbers", "numbers barred" or "shares".
    """

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str | Cell]]
    folded: bool = False
    style: str = ""


@dataclass(frozen=True)
class Figure:
    """A Plotly figure.

    Attributes:
        title: heading above the figure.
        caption: description, also the text alternative.
        data: traces.
        layout: layout; the report adds the template.
        height: height [px].
    """

    title: str
    caption: str
    data: list[Trace]
    layout: Trace = field(default_factory=dict[str, Any])
    height: int = 320


Block = str | tuple[str, ...] | DataTable | Figure
"""A paragraph, a list, a table or a figure."""


@dataclass(frozen=True)
class PageContents:
    """Contents of a page.

    Attributes:
        title, subtitle, lead: texts of the header.
        actions: first blocks of the page: recommended actions.
        alerts: name and message of each failed check or warning.
        first: blocks of the first screen, with figures in a second column.
        sections: blocks of each section below the first screen, by title.
    """

    title: str
    subtitle: str
    lead: str
    first: Sequence[Block]
    sections: Mapping[str, Sequence[Block]] = field(default_factory=dict[str, Sequence[Block]])
    alerts: Sequence[tuple[str, str]] = ()
    actions: Sequence[Block] = ()


def anchor(title: str) -> str:
    """Return the name of a section, for links to it."""
    return re.sub(r"\W+", "-", title.lower())


def axes(x: str, y: str, **more: Any) -> Trace:
    """Return a layout with titled axes."""
    return {"xaxis": {"title": {"text": x}}, "yaxis": {"title": {"text": y}}, **more}


def line(x: Iterable[float], y: Iterable[float], name: str, series: int, **more: Any) -> Trace:
    """Return a line trace with colour and dash of its series."""
    style = {"color": SERIES[series % 4], "dash": DASHES[series % 4], "width": 2, **more.pop("line", {})}
    return {"type": "scatter", "mode": "lines", "x": short(x), "y": short(y), "name": name, "line": style, **more}


def pieces(curves: Sequence[tuple[FloatArray, FloatArray]], name: str, series: int) -> Trace:
    """Return one thin line trace of several curves, with gaps between them."""
    x, y = ([value for curve in curves for value in (*curve[axis], math.nan)] for axis in (0, 1))
    return line(x, y, name, series, line={"width": 1})


def points(x: Iterable[float], y: Sequence[Any], name: str, marker: Trace, **more: Any) -> Trace:
    """Return a marker trace; `y` may be names."""
    return {"type": "scatter", "mode": "markers", "x": short(x, 6), "y": y, "name": name, "marker": marker, **more}


def level(y: float, words: str = "", colour: str = MUTED, dash: str = "dash") -> Trace:
    """Return a layout shape: a horizontal line across the figure, with a label."""
    label = {"text": words, "textposition": "end", "font": {"size": 11, "color": colour}}
    ends = {"xref": "paper", "x0": 0, "x1": 1, "y0": y, "y1": y}
    return {"type": "line", **ends, "line": {"color": colour, "dash": dash, "width": 1}, "label": label}


def upright(x: float, words: str = "", colour: str = MUTED) -> Trace:
    """Return a layout shape: a vertical line across the figure, with a label."""
    shape = level(x, words, colour)
    shape["label"] |= {"textangle": 0, "xanchor": "left", "yanchor": "top"}
    return {**shape, "xref": "x", "x0": x, "x1": x, "yref": "paper", "y0": 0, "y1": 1}


def plain(words: str) -> str:
    """Return text with escaped tags, which Plotly would interpret."""
    return html.escape(words, quote=False)


def short(values: Iterable[float], digits: int = 4) -> list[float | None]:
    """Return values rounded to significant digits; None for non-finite ones."""
    return [float(f"{value:.{digits}g}") if math.isfinite(value) else None for value in values]


def number(value: float | None, factor: float, form: str) -> str:
    """Return a formatted value times a factor, without minus zero; a dash for None."""
    if value is None:
        return "-"
    text = format(value * factor, form)
    if any(digit in text for digit in "123456789"):
        return text
    return text.replace("-", "+" if form.startswith("+") else "")
