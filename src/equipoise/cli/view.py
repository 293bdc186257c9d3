"""`equipoise view`, and the same beside a run: `--view` and `--rerun`."""

from __future__ import annotations

import json as json_module
import sys
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from equipoise.cli.flags import FOR_LOGS, Described, Duration, File, Flag, Output, RobotFlags, Topic, load
from equipoise.cli.settings import seconds
from equipoise.errors import RecordingError, SettingsError
from equipoise.logs.topics import Topics

if TYPE_CHECKING:
    from equipoise.calibration.run_folder import RunFolder
    from equipoise.view.open import Showing
    from equipoise.view.process import ViewerProcess

RerunFile = Annotated[Path | None, arg(metavar="FILE.rrd", help_behavior_hint="")]
ViewPort = Annotated[int, arg(metavar="PORT")]
DEFAULT_PORT = 8080


def view(
    run: Annotated[Positional[Path], arg(metavar="RUN", help="Run folder of a calibration, or a log of another kind.")],
    *,
    follow: Flag = False,
    robot: Annotated[str | None, arg(metavar="ROBOT", help_behavior_hint="")] = None,
    view_port: ViewPort = DEFAULT_PORT,
    view_host: str = "127.0.0.1",
    rerun: RerunFile = None,
    joint_topic: Topic = None,
    imu_topic: Topic = None,
    joint_map: File = None,
    columns: File = None,
    start: Annotated[Duration, arg(name="from")] = None,
    until: Duration = None,
    description: Described = RobotFlags(),  # noqa: B008
    output: Output = Output(),  # noqa: B008
) -> None:
    """Look at a run or at any recording in a browser: the robot moving, the support line, the CoM estimate closing in.

    The page has a timeline with play, pause, speed and a list of the trials; it stays until Ctrl-C. Needs no robot and no
    simulator. With --rerun the same is written for Rerun instead.

    Example: equipoise view runs/go2
             equipoise view bags/wiggle --robot go2
             equipoise view runs/go2 --rerun go2.rrd

    Args:
        follow: Keep up with a run, or with the file of 'equipoise record' (give --robot), that another process writes.
        robot: Whose log it is: a name or a model file, as in 'calibrate'. A run of ours knows.
        view_port: Of the page; 0: any that is free.
        view_host: Where the page is served; 0.0.0.0 lets other computers see it. Prefer ssh -L: see docs/view.md.
        rerun: Write a file for Rerun and serve no page.
        joint_topic: Joint states of a bag that has several.
        imu_topic: IMU samples of a bag that has several.
        joint_map: TOML file with lines as FL_hip_joint = "front_left_hip": the log's name, or column, of a joint.
        columns: TOML file with lines as gyro.x = "wx", for a table with other names; without it they are proposed.
        start: Use the log from here on, after its first sample.
        until: Use the log until here.
    """
    from equipoise.view.open import Viewing
    from equipoise.view.process import how_to_look, serve
    from equipoise.view.rerun_file import require_rerun_file
    from equipoise.view.viser_page import require_port, require_viser

    if rerun is not None:
        require_rerun_file(rerun)
    else:
        require_viser()
        require_port(view_host, view_port)
    span = seconds(start, "from"), seconds(until, "until")
    flags = _LogFlags(Topics(joint_topic, imu_topic), joint_map, columns, span, description)
    showing = _opened(run, robot, flags, follow, not output.silent)
    if rerun is not None:
        _write(rerun, showing, output.silent)
        _tell({"rerun": str(rerun)}, f"saved: {rerun}\nopen it: rerun {rerun}", output.json)
        return

    def greet(url: str) -> None:
        _tell({"url": url}, url if output.quiet else f"{how_to_look(url)}\nCtrl-C ends it.", output.json)

    with Viewing(showing) as viewing:
        try:
            serve(viewing, showing.title, view_host, view_port, follow, greet)
        except KeyboardInterrupt:  # how it is meant to end
            return


@dataclass(frozen=True)
class _LogFlags:
    """Flags that only logs that are not ours know."""

    topics: Topics
    joint_map: Path | None
    columns: Path | None
    span: tuple[float | None, float | None]
    description: RobotFlags

    def refuse(self) -> None:
        """Raise SettingsError if one was given."""
        if self != _LogFlags(Topics(), None, None, (None, None), RobotFlags()):
            raise SettingsError(FOR_LOGS)


def _opened(path: Path, robot: str | None, flags: _LogFlags, follow: bool, asking: bool) -> Showing:
    from equipoise.logs.reader import is_log
    from equipoise.terminal.columns import read_as_told
    from equipoise.view.open import follow_log, open_log, open_run

    if robot is None:
        flags.refuse()
        try:
            return open_run(path)
        except RecordingError as error:
            hint = "; if it is another kind of log, say whose with --robot" if is_log(path) else ""
            raise RecordingError(f"{error}{hint}") from error
    model = load(robot, flags.description)
    if follow:
        return follow_log(path, model)
    log = read_as_told(path, model, flags.topics, flags.joint_map, flags.columns, flags.span, asking)
    return open_log(path, model, log)


def _write(path: Path, showing: Showing, quiet: bool) -> None:
    from equipoise.view.open import Viewing
    from equipoise.view.rerun_file import write_rerun

    with Viewing(showing) as viewing:
        viewing.refresh()
        if viewing.film.empty:
            raise RecordingError("there is nothing to see: the log holds no samples of joints and IMU")
        if not quiet:
            print(f"estimating after each of {len(viewing.film.ends)} trials for {path} ...", file=sys.stderr)
        viewing.settle()
        write_rerun(path, showing.title, viewing.camera)


def _tell(table: dict[str, str], words: str, json: bool) -> None:
    print(json_module.dumps({"schema": "equipoise.view/1", **table}) if json else words, flush=True)


@dataclass(frozen=True)
class Watch:
    """What the flags of a verb that moves a robot say about looking on.

    Attributes:
        view: whether to open a page.
        port: port of the page.
        rerun: Rerun file to write when the run is over.
    """

    view: bool = False
    port: int = DEFAULT_PORT
    rerun: Path | None = None

    def check(self) -> None:
        """Refuse what will not work, before anything moves.

        Raises:
            MissingDependencyError: a package is not installed.
            SettingsError: the port is in use, or given without a page.
            OutputError: the file cannot be written.
        """
        if self.view:
            from equipoise.view.process import HOST
            from equipoise.view.viser_page import require_port, require_viser

            require_viser()
            require_port(HOST, self.port)
        elif self.port != DEFAULT_PORT:
            raise SettingsError("--view-port is the port of --view's page; give --view too")
        if self.rerun is not None:
            from equipoise.view.rerun_file import require_rerun_file

            require_rerun_file(self.rerun)

    @contextmanager
    def over(self, folder: RunFolder, quiet: bool, stays: bool = True) -> Generator[None]:
        """Look on while a run is made into a folder, and save what was seen.

        Args:
            quiet: whether to say nothing but where the page is.
            stays: whether the page stays after the run, until Enter or Ctrl-C, if somebody is at the terminal.
        """
        if not self.view:
            yield
        else:
            from equipoise.view.process import ViewerProcess, how_to_look

            with ViewerProcess(folder.path, port=self.port) as page:
                print(how_to_look(page.url), file=sys.stderr, flush=True)
                yield
                self._save(folder, quiet)
                if stays and sys.stdin.isatty():
                    _linger(page)
                return
        self._save(folder, quiet)

    def _save(self, folder: RunFolder, quiet: bool) -> None:
        if self.rerun is not None:
            from equipoise.view.open import open_run

            _write(self.rerun, open_run(folder.path), quiet)
            print(f"saved: {self.rerun}", file=sys.stderr)


def _linger(page: ViewerProcess) -> None:
    print(f"The page stays at {page.url}: Enter or Ctrl-C ends it.", file=sys.stderr, flush=True)
    try:
        sys.stdin.readline()
    except KeyboardInterrupt:
        print(file=sys.stderr)
