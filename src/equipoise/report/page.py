"""Reports as self-contained HTML files; the import raises MissingDependencyError if Plotly is not installed."""

from __future__ import annotations

import html
import json
from importlib.resources import files
from pathlib import Path

from equipoise._version import __version__
from equipoise.calibration.run_header import HEADER
from equipoise.errors import MissingDependencyError

try:
    from plotly.offline import get_plotlyjs
except ModuleNotFoundError as error:
    raise MissingDependencyError("reports need Plotly: pip install 'equipoise[report]'") from error

from equipoise.figures.blocks import INK, MUTED, SERIES, Figure, PageContents, Trace
from equipoise.report.comparison import comparison_contents
from equipoise.report.contents import run_contents
from equipoise.report.html import document_html, figures_of
from equipoise.result.calibration import Calibration
from equipoise.user_file import typed, write_file

REPORT = "report.html"
_GRID = "#dde1e5"
_FONTS = "system-ui, 'Segoe UI', Roboto, 'Liberation Sans', Arial, sans-serif"
_AXIS = {
    "gridcolor": _GRID, "zerolinecolor": _GRID, "linecolor": MUTED, "tickcolor": _GRID, "ticks": "outside",
    "automargin": True,
}  # fmt: skip
_TEMPLATE: Trace = {
    "layout": {
        "colorway": SERIES,
        "font": {"family": _FONTS, "size": 12, "color": INK},
        "margin": {"l": 56, "r": 12, "t": 28, "b": 44},
        "paper_bgcolor": "#ffffff",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0},
        "xaxis": _AXIS,
        "yaxis": _AXIS,
        "bargap": 0.15,
    }
}


def save_report(result: Calibration, path: str | Path) -> Path:
    """Write the report of a run to a file, or as report.html into an existing folder.

    A result of `calibrate`, `RunFolder.estimate` or `estimate_log` gives the full report. A result from a JSON file gives a
    report without the figures that need the recordings.

    Raises:
        OutputError: the file cannot be written.
    """
    path = Path(path)
    path = path / REPORT if path.is_dir() else path
    of_run = path.name == REPORT and (path.parent / HEADER).is_file()
    return save_page(run_contents(result, typed(path.parent) if of_run else "RUN"), path)


def save_comparison(results: dict[str, Calibration], path: str | Path) -> Path:
    """Write the report that compares runs, given by their names to show.

    Raises:
        SettingsError: fewer than two runs.
        OutputError: the file cannot be written.
    """
    return save_page(comparison_contents(results), path)


def save_page(document: PageContents, path: str | Path) -> Path:
    """Write a page; raises OutputError if that fails."""
    path = Path(path)
    path = path / REPORT if path.is_dir() else path
    write_file(path, page(document), "the report ")
    return path


def page(document: PageContents) -> str:
    """Return the HTML text of a page."""
    folder = files("equipoise.report") / "page"
    links, body = document_html(document)
    parts = {
        "title": html.escape(document.title),
        "version": html.escape(__version__),
        "style": (folder / "style.css").read_text(encoding="utf-8"),
        "links": links,
        "body": body,
        "plotly": get_plotlyjs(),
        "figures": _json(figures_of(document)),
    }
    head, *rest = (folder / "page.html").read_text(encoding="utf-8").split("{{")
    return head + "".join(parts[name] + after for name, after in (part.split("}}", 1) for part in rest))


def _json(figures: list[Figure]) -> str:
    """Return data and layouts as JSON, escaped so that no text in it can end the enclosing script element."""
    plots = [(one.data, {"template": _TEMPLATE, "height": one.height, **one.layout}) for one in figures]
    text = json.dumps(plots, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
