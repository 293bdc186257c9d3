"""`equipoise view`, and the viewer of `--view`."""

from __future__ import annotations

import json as json_module
import sys
import threading
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from equipoise.cli.flags import Described, Flag, LogFlags, Output, Run, open_run
from equipoise.errors import OutputError
from equipoise.robot.catalog import load_robot
from equipoise.robot.description import RobotDescription
from equipoise.user_file import typed

if TYPE_CHECKING:
    from collections.abc import Iterable

    from equipoise.calibration.run_folder import RunFolder
    from equipoise.method.method import Method
    from equipoise.robot.model import RobotModel
    from equipoise.view.follow import News

RECORDING = "view.rrd"
"""Name of the Rerun file in a run folder."""


def view(
    run: Run,
    *,
    follow: Flag = False,
    browser: Flag = False,
    out: Annotated[Path | None, arg(metavar="FILE.rrd", help_behavior_hint="")] = None,
    source: Annotated[LogFlags, arg(name="log")],
    description: Described,
    output: Output,
) -> None:
    """Show a run or a log in the Rerun viewer: robot motion, support line and the
    converging CoM estimate.

    Opens a window. On a computer without a display it writes a file and prints its
    path.

    Example: equipoise view runs/go2
             equipoise view bags/wiggle --robot go2
             equipoise view runs/go2 --out go2.rrd

    Args:
        follow: Follow a run, or a file of 'equipoise record' (with --robot), while another process writes it.
        browser: Serve the viewer to a browser on this computer until Ctrl-C. To open it elsewhere, type the printed `ssh`.
        out: Write this file instead of opening a viewer; 'rerun FILE.rrd' opens it.
    """
    from equipoise.view.viewer import BROWSER, how_to_open, require_rerun
    from equipoise.view.viewer import view as show

    require_rerun()
    target = str(out) if out else _target(browser, Path(f"{run.stem}.rrd") if source.robot else run / RECORDING)
    if out or source.robot:
        _require_new(target)
    title, model, method, news = _opened(run, source, description, follow, not output.silent)

    def announce(address: str) -> None:
        if target == BROWSER and output.json:
            _print_json("url", address)
        elif target == BROWSER:
            print(address if output.quiet else f"{how_to_open(address)}\nCtrl-C ends it.", flush=True)
        elif not output.silent:
            print(f"{how_to_open(address)}; an estimate is computed after each trial", file=sys.stderr, flush=True)

    try:
        show(target, title, model, method, news, announce, threading.Event())
    except KeyboardInterrupt:  # ends the server, or following a run
        return
    if Path(target).suffix == ".rrd":
        _print_json("file", target) if output.json else print(_saved(target))


def _opened(
    path: Path, source: LogFlags, description: RobotDescription, follow: bool, asking: bool
) -> tuple[str, RobotModel, Method, Iterable[News]]:
    from equipoise.view.follow import follow as followed
    from equipoise.view.follow import log_news

    if source.robot is None:
        folder = open_run(path, source, description)
        return folder.path.name, folder.robot(), folder.method(), followed(path, lambda: follow)
    model = load_robot(source.robot, description)
    news = followed(path, lambda: True) if follow else [log_news(model, source.read(path, model, asking))]
    from equipoise.bayesian.method import BayesianMethod

    return path.name, model, BayesianMethod(), news


def _require_new(target: str) -> None:
    """Raise OutputError for a file that exists, or whose folder does not."""
    from equipoise.view.viewer import BROWSER, WINDOW

    path = Path(target)
    if target in (WINDOW, BROWSER):
        return
    if path.suffix != ".rrd":
        raise OutputError(f"{target!r} is not the name of a Rerun file; append .rrd")
    if path.exists():
        raise OutputError(f"{target!r} exists; name a new file with --out")
    if not path.parent.is_dir():
        raise OutputError(f"{target!r} cannot be written: there is no folder {str(path.parent)!r}")


def _target(browser: bool, file: Path) -> str:
    """Return the browser if requested, a window if there is a display, else a file."""
    from equipoise.view.viewer import BROWSER, WINDOW, has_display

    return BROWSER if browser else WINDOW if has_display() else str(file)


def _print_json(name: str, value: str) -> None:
    print(json_module.dumps({"schema": "equipoise.view/1", name: value}), flush=True)


def _saved(path: str) -> str:
    return f"saved: {path}\nopen it: rerun {typed(path)}"


@contextmanager
def viewer_of(folder: RunFolder, browser: bool) -> Generator[None]:
    """Show a run while it is written into a folder; a page is served after the run until Enter or Ctrl-C at a terminal.

    Args:
        browser: true to serve a page instead of opening a window.
    """
    from equipoise.view.viewer import BROWSER, live_viewer

    target = _target(browser, folder.path / RECORDING)
    with live_viewer(folder.path, target) as process:
        yield
        if target == BROWSER and sys.stdin.isatty() and process.poll() is None:
            _wait_for_enter()
    if process.returncode == 0 and Path(target).suffix == ".rrd":
        print(_saved(target), file=sys.stderr)


def _wait_for_enter() -> None:
    print("The view is served until Enter or Ctrl-C.", file=sys.stderr, flush=True)
    try:
        sys.stdin.readline()
    except KeyboardInterrupt:
        print(file=sys.stderr)
