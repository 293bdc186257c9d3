"""From contents to one self-contained file; importing it raises MissingDependencyError where Plotly is not installed."""

from __future__ import annotations

import html
import json
from importlib.resources import files
from pathlib import Path
from typing import Any

from equipoise._version import __version__
from equipoise.errors import MissingDependencyError

try:
    from plotly.offline import get_plotlyjs
except ModuleNotFoundError as error:
    raise MissingDependencyError("reports need Plotly: pip install 'equipoise[pictures]'") from error

from equipoise.report.comparison import comparison_contents
from equipoise.report.contents import run_contents
from equipoise.result.calibration import Calibration
from equipoise.user_file import write_file

REPORT = "report.html"
_SCRIPTS = ("tables.js", "plan_view.js", "figures.js", "page.js")


def save_report(result: Calibration, path: str | Path) -> Path:
    """Write the page of a run: to a file in a folder that is there, or as report.html into such a folder.

    A result of `calibrate`, `RunFolder.estimate` or `estimate_log` has all it can show; one from a JSON file lacks
    what only recordings tell.

    Raises:
        OutputError: it cannot be written.
    """
    return _save(run_contents(result), path)


def save_comparison(results: dict[str, Calibration], path: str | Path) -> Path:
    """Write the page that compares runs, by the names to show.

    Raises:
        SettingsError: fewer than two.
        OutputError: it cannot be written.
    """
    return _save(comparison_contents(results), path)


def _save(contents: dict[str, Any], path: str | Path) -> Path:
    path = Path(path)
    path = path / REPORT if path.is_dir() else path
    write_file(path, page(contents), "the report ")
    return path


def page(contents: dict[str, Any]) -> str:
    """The whole page as text."""
    folder = files("equipoise.report") / "page"

    def read(name: str) -> str:
        return (folder / name).read_text(encoding="utf-8")

    parts = {
        "title": html.escape(f"{contents['title']}: equipoise"),
        "version": html.escape(__version__),
        "style": read("style.css"),
        "contents": _json(contents),
        "scripts": "\n".join(read(name) for name in _SCRIPTS),
        "plotly": get_plotlyjs(),
    }
    head, *rest = read("page.html").split("{{")
    return head + "".join(parts[name] + after for name, after in (part.split("}}", 1) for part in rest))


def _json(contents: dict[str, Any]) -> str:
    """JSON that no string in it can end the script element that holds it."""
    text = json.dumps(contents, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
