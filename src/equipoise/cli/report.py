"""`equipoise report`: page of a run, and page that compares runs."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from equipoise.calibration.run_header import read_header
from equipoise.cli.flags import File, Output
from equipoise.errors import MissingDependencyError, OutputError, SettingsError

if TYPE_CHECKING:
    from equipoise.result.calibration import Calibration

_COMPARISON = "comparison.html"
Runs = Annotated[
    Positional[tuple[Path, ...]],
    arg(metavar="RUN...", help="Run folders, or JSON results of 'estimate LOG --out'.", help_behavior_hint=""),
]


def report(runs: Runs, *, out: File = None, output: Output) -> None:
    """Write report.html of a run again, or one page that compares two or more runs.

    The page is a single file that needs no network; docs/report-and-viewer.md explains
    it. The runs may be of different robots.

    Example: equipoise report runs/go2
             equipoise report runs/before runs/after --out before-after.html

    Args:
        out: File to write or replace, in an existing folder; default report.html in the run folder, or a new comparison.html
            in this folder.
    """
    if not runs:
        raise SettingsError("no run is given; name a run folder, for example runs/unitree_a1-20260101-120000")
    for path in runs:
        if not path.is_file():
            read_header(path)
    from equipoise.report.page import REPORT, save_comparison, save_report

    if len(runs) == 1:
        page = runs[0].with_suffix(".html") if runs[0].is_file() else runs[0] / REPORT
        file = save_report(_estimated(runs[0]), out or page)
    else:
        results = _named(runs)
        if out is None and Path(_COMPARISON).exists():  # it may compare other runs
            raise OutputError(f"{_COMPARISON!r} exists; to replace it, pass --out {_COMPARISON}")
        file = save_comparison(results, out or Path(_COMPARISON))
    table = {"schema": "equipoise.report/1", "report": str(file), "runs": [str(path) for path in runs]}
    output.write(table, lambda: None if output.quiet else print(f"saved: {file}"))


def _estimated(path: Path) -> Calibration:
    """Return a result, with the data for its figures if the recordings are complete."""
    from equipoise.calibration.run_folder import RunFolder
    from equipoise.result.calibration import Calibration

    return Calibration.load(path) if path.is_file() else RunFolder.open(path).shown()


def _named(paths: tuple[Path, ...]) -> dict[str, Calibration]:
    """Return results by the shortest distinct end of their paths; raises SettingsError for a duplicate."""
    parts = [path.resolve().parts for path in paths]
    for count in range(1, max(len(part) for part in parts) + 1):
        names = ["/".join(part[-count:]) for part in parts]
        if len(set(names)) == len(names):
            return {name: _result(path) for name, path in zip(names, paths, strict=True)}
    duplicate = next(str(path) for path in paths if [other.resolve() for other in paths].count(path.resolve()) > 1)
    raise SettingsError(f"{duplicate!r} is named twice; give different runs")


def _result(path: Path) -> Calibration:
    """Return the saved result of a run, or estimate it."""
    from equipoise.calibration.run_folder import RunFolder
    from equipoise.result.calibration import Calibration

    if path.is_file():
        return Calibration.load(path)
    folder = RunFolder.open(path)
    return folder.result() if folder.complete else folder.estimate()


def try_to_save(result: Calibration, path: Path, remedy: str = "") -> list[Path]:
    """Save the page of a result; print a warning if it cannot be written.

    Args:
        path: file or folder.
        remedy: text after the warning.
    """
    try:
        from equipoise.report.page import save_report

        return [save_report(result, path)]
    except (OutputError, MissingDependencyError) as error:
        print(f"warning: {error}{remedy}", file=sys.stderr)
        return []
