"""What pages are made of: tables, figures as Plotly specifications, and texts, all as JSON values.

Colours are names of the style sheet's variables ("--accent"), so that a figure follows the theme.
"""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

Block = dict[str, Any]
Cell = str | Mapping[str, Any]
SERIES = ("--series-1", "--series-2", "--series-3", "--series-4")
DASHES = ("solid", "dash", "dot", "dashdot")
"""Lines differ by dash as well as by colour."""


def table(columns: Sequence[str], rows: Sequence[Sequence[Cell]], caption: str, **more: Any) -> Block:
    """A table.

    Args:
        columns: heads; those that begin with "|" are of numbers, and stand on the right.
        rows: cells: text; or {"text", "tone"}, {"verdict"}, {"bar"}.
        caption: what it shows.
        more: `folded`: whether it is opened on demand.
    """
    heads = [{"text": head.removeprefix("|"), "number": head.startswith("|")} for head in columns]
    return {"type": "table", "columns": heads, "rows": [list(row) for row in rows], "caption": caption, **more}


def text(*sentences: str) -> Block:
    """A paragraph."""
    return {"type": "text", "text": " ".join(sentences)}


def items(sentences: Iterable[str]) -> Block:
    """A list."""
    return {"type": "items", "items": list(sentences)}


def figure(title: str, caption: str, data: list[Block], layout: Block, **more: Any) -> Block:
    """A figure.

    Args:
        title: above it.
        caption: what is to be seen; also for those who cannot see it.
        data: Plotly's traces.
        layout: Plotly's layout; the page adds the theme.
        more: `height` [px]; `views`: ways to look at it.
    """
    return {"type": "figure", "title": title, "caption": caption, "data": data, "layout": layout, **more}


def axes(x: str, y: str, **more: Any) -> Block:
    """A layout with titled axes."""
    return {"xaxis": {"title": {"text": x}}, "yaxis": {"title": {"text": y}}, **more}


def line(x: Iterable[float], y: Iterable[float], name: str, series: int, **more: Any) -> Block:
    """A line of a series, told from others by colour and dash."""
    style = {"color": SERIES[series % 4], "dash": DASHES[series % 4], "width": 2, **more.pop("line", {})}
    return {"type": "scatter", "mode": "lines", "x": short(x), "y": short(y), "name": name, "line": style, **more}


def section(name: str, title: str, blocks: Sequence[Block | None]) -> Block | None:
    """A part of the page below the first screen; None if there is nothing in it."""
    there = [block for block in blocks if block is not None]
    return {"id": name, "title": title, "blocks": there} if there else None


def plain(words: str) -> str:
    """For Plotly, which reads tags in its texts: no word of a user's is one."""
    return html.escape(words, quote=False)


def short(values: Iterable[float], digits: int = 4) -> list[float | None]:
    """Rounded to so many digits, since a page must stay small; what is no number becomes None."""
    return [float(f"{value:.{digits}g}") if np.isfinite(value) else None for value in values]
