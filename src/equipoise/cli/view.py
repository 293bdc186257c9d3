"""`equipoise view`, and the view beside a run: `--view`."""

from __future__ import annotations

import json as json_module
import sys
import threading
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from equipoise.cli.flags import FOR_LOGS, Described, Duration, File, Flag, Output, RobotFlags, Topic, load
from equipoise.cli.settings import seconds
from equipoise.errors import OutputError, RecordingError, SettingsError
from equipoise.logs.topics import Topics
from equipoise.user_file import typed

if TYPE_CHECKING:
    from collections.abc import Iterable

    from equipoise.calibration.run_folder import RunFolder
    from equipoise.method.method import Method
    from equipoise.robot.model import RobotModel
    from equipoise.view.follow import News

RECORDING = "view.rrd"
"""Name of the file in a run folder."""


def view(
    run: Annotated[Positional[Path], arg(metavar="RUN", help="Run folder of a calibration, or a log of another kind.")],
    *,
    follow: Flag = False,
    robot: Annotated[str | None, arg(metavar="ROBOT", help_behavior_hint="")] = None,
    browser: Flag = False,
    out: Annotated[Path | None, arg(metavar="FILE.rrd", help_behavior_hint="")] = None,
    joint_topic: Topic = None,
    imu_topic: Topic = None,
    joint_map: File = None,
    columns: File = None,
    start: Annotated[Duration, arg(name="from")] = None,
    until: Duration = None,
    description: Described = RobotFlags(),  # noqa: B008
    output: Output = Output(),  # noqa: B008
) -> None:
    """Show a run or any recording in the Rerun viewer: the robot moving, the support line, the CoM estimate converging.

    A window opens. On a computer without a display a file is written instead, and its path is printed.

    Example: equipoise view runs/go2
             equipoise view bags/wiggle --robot go2
             equipoise view runs/go2 --out go2.rrd

    Args:
        follow: Keep up with a run, or with the file of 'equipoise record' (give --robot), that another process writes.
        robot: Robot of a log: a name or a model file, as in 'calibrate'. A run folder has its own.
        browser: Serve the viewer to a browser on this computer until Ctrl-C. See docs/view.md for another computer.
        out: Write this file and open no viewer; 'rerun FILE.rrd' opens it.
        joint_topic: Joint states of a bag that has several.
        imu_topic: IMU samples of a bag that has several.
        joint_map: TOML file with lines as FL_hip_joint = "front_left_hip": the log's name, or column, of a joint.
        columns: TOML file with lines as gyro.x = "wx", for a table with other names; without it they are proposed.
        start: Use the log from here on, after its first sample.
        until: Use the log until here.
    """
    from equipoise.view.viewer import BROWSER, how_to_open, require_rerun
    from equipoise.view.viewer import view as show

    require_rerun()
    span = seconds(start, "from"), seconds(until, "until")
    flags = _LogFlags(Topics(joint_topic, imu_topic), joint_map, columns, span, description)
    target = str(out) if out else _target(browser, Path(f"{run.stem}.rrd") if robot else run / RECORDING)
    if out or robot:
        _require_new(target)
    title, model, method, news = _opened(run, robot, flags, follow, not output.silent)

    def greet(place: str) -> None:
        if target == BROWSER and output.json:
            _print_json("url", place)
        elif target == BROWSER:
            print(place if output.quiet else f"{how_to_open(place)}\nCtrl-C ends it.", flush=True)
        elif not output.silent:
            print(f"{how_to_open(place)}; an estimate is computed after each trial", file=sys.stderr, flush=True)

    try:
        show(target, title, model, method, news, greet, threading.Event())
    except KeyboardInterrupt:  # ends the page, or a run that is followed
        return
    if Path(target).suffix == ".rrd":
        _print_json("file", target) if output.json else print(_saved(target))


@dataclass(frozen=True)
class _LogFlags:
    """Flags for logs of other programs."""

    topics: Topics
    joint_map: Path | None
    columns: Path | None
    span: tuple[float | None, float | None]
    description: RobotFlags

    def refuse(self) -> None:
        """Raise SettingsError if one of them was given."""
        if self != _LogFlags(Topics(), None, None, (None, None), RobotFlags()):
            raise SettingsError(FOR_LOGS)


def _opened(
    path: Path, robot: str | None, flags: _LogFlags, follow: bool, asking: bool
) -> tuple[str, RobotModel, Method, Iterable[News]]:
    from equipoise.calibration.run_folder import RunFolder
    from equipoise.logs.reader import is_log
    from equipoise.precise.method import Precise
    from equipoise.terminal.columns import read_as_told
    from equipoise.view.follow import follow as followed
    from equipoise.view.follow import log_news

    if robot is None:
        flags.refuse()
        try:
            folder = RunFolder.open(path)
        except RecordingError as error:
            hint = "; if it is another kind of log, say whose with --robot" if is_log(path) else ""
            raise RecordingError(f"{error}{hint}") from error
        return folder.path.name, folder.robot(), folder.method(), followed(path, lambda: follow)
    model = load(robot, flags.description)
    if follow:
        return path.name, model, Precise(), followed(path, lambda: True)
    log = read_as_told(path, model, flags.topics, flags.joint_map, flags.columns, flags.span, asking)
    return path.name, model, Precise(), [log_news(model, log)]


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
    """Return the browser if it is asked for, a window if one can be opened, else a file."""
    from equipoise.view.viewer import BROWSER, WINDOW, has_display

    return BROWSER if browser else WINDOW if has_display() else str(file)


def _print_json(name: str, value: str) -> None:
    print(json_module.dumps({"schema": "equipoise.view/1", name: value}), flush=True)


def _saved(path: str) -> str:
    return f"saved: {path}\nopen it: rerun {typed(path)}"


@dataclass(frozen=True)
class Watch:
    """Settings of the view beside a run.

    Attributes:
        view: whether the run is shown.
        browser: whether a page is served instead of a window.
    """

    view: bool = False
    browser: bool = False

    def check(self) -> None:
        """Refuse what will not work, before anything moves.

        Raises:
            MissingDependencyError: Rerun is not installed.
            SettingsError: a browser without a view.
        """
        if self.browser and not self.view:
            raise SettingsError("--browser is where --view shows the run; give --view too")
        if self.view:
            from equipoise.view.viewer import require_rerun

            require_rerun()

    @contextmanager
    def over(self, folder: RunFolder, stays: bool = True) -> Generator[None]:
        """Show a run while it is written into a folder.

        Args:
            stays: whether a page is served after the run, until Enter or Ctrl-C at a terminal.
        """
        if not self.view:
            yield
            return
        from equipoise.view.viewer import BROWSER, viewer_beside

        target = _target(self.browser, folder.path / RECORDING)
        with viewer_beside(folder.path, target) as process:
            yield
            if target == BROWSER and stays and sys.stdin.isatty() and process.poll() is None:
                _wait_for_enter()
        if process.returncode == 0 and Path(target).suffix == ".rrd":
            print(_saved(target), file=sys.stderr)


def _wait_for_enter() -> None:
    print("The view is served until Enter or Ctrl-C.", file=sys.stderr, flush=True)
    try:
        sys.stdin.readline()
    except KeyboardInterrupt:
        print(file=sys.stderr)
