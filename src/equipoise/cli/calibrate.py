"""`equipoise calibrate`."""

from __future__ import annotations

import dataclasses
import json as json_module
import sys
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from equipoise.calibration.run_header import read_header
from equipoise.cli import print_message
from equipoise.cli.arguments import chosen
from equipoise.cli.flags import Described, File, Flag, Output, Required, RobotOrNone, Verbose, exit_code
from equipoise.cli.methods import METHOD_FLAGS
from equipoise.cli.operator_prompt import imu_pose_missing, with_imu_pose
from equipoise.cli.parsing import ChosenFlags, Verb
from equipoise.cli.report import try_to_save
from equipoise.cli.target import TARGET_FLAGS, RunTarget, SimulatedTarget
from equipoise.cli.view import viewer_of
from equipoise.errors import SettingsError
from equipoise.method.method import Method
from equipoise.robot.catalog import load_robot

if TYPE_CHECKING:
    from equipoise.calibration.run_folder import RunFolder
    from equipoise.result.calibration import Calibration
    from equipoise.robot.model import RobotModel

_DEFAULT_ROBOT = "unitree_a1"
CHOSEN: dict[type, ChosenFlags] = {Method: METHOD_FLAGS, RunTarget: TARGET_FLAGS}


@dataclass(frozen=True)
class ShownFlags(Output):
    """Output of a run and its result.

    Attributes:
        view: Show the robot and the converging estimate in a Rerun window or, without a display, record view.rrd in the run
            folder. 'equipoise view RUN' shows a finished run. The control loop does not wait for the viewer.
        browser: With --view: serve the viewer to a browser. At a terminal it is served until Enter or Ctrl-C.
        report: Do not write the page report.html in the run folder.
        verbose: Show the duration of each stage of the estimate.
    """

    view: Flag = False
    browser: Flag = False
    report: Flag = True
    verbose: Verbose = False

    def check(self) -> None:
        """Raise if the view cannot work, before anything moves.

        Raises:
            MissingDependencyError: Rerun is not installed.
            SettingsError: --browser is given without --view.
        """
        if self.browser and not self.view:
            raise SettingsError("--browser needs --view; give both")
        if self.view:
            from equipoise.view.viewer import require_rerun

            require_rerun()

    @contextmanager
    def viewing(self, folder: RunFolder) -> Generator[None]:
        """Show a run while it is written, and serve it to a browser afterwards until Enter or Ctrl-C."""
        if not self.view:
            yield
            return
        with viewer_of(folder, self.browser):
            yield

    def show(self, result: Calibration, folder: RunFolder) -> None:
        """Write the page of a result and print the result."""
        from equipoise.terminal.results import print_calibration

        files = [folder.path / "calibration.json"]
        if self.report:
            files += try_to_save(result, folder.path, f"; to retry: equipoise report {folder.path} --out FILE")
        if self.json:
            print(result.to_json(), end="")
        else:
            print_calibration(result, files, self.verbose, folder.path)


def calibrate(
    robot: RobotOrNone = None,
    *,
    dry_run: Flag = False,
    resume: Annotated[Path | None, arg(metavar="RUN", help_behavior_hint="")] = None,
    out: File = None,
    fail_unless: Required = None,
    method: Method,
    description: Described,
    target: Annotated[RunTarget, arg(name="platform")],
    output: ShownFlags,
) -> int:
    """Estimate a quadruped's mass, centre of mass and inertia, in simulation or on the
    robot.

    The run folder keeps every recording. On a robot, a guard checks every command
    and sample; after a fault it lowers the robot, or damps its joints if the robot
    no longer follows commands.

    Example: equipoise calibrate unitree_a1 --payload 1.5,0.1,0,0.08 --seed 3 --out runs/a1
             equipoise calibrate go2 --sim-preset stress --disable-effect springs --enable-effect cable=0.5
             equipoise calibrate go2 --platform unitree-go2 --set interface=eth0
             equipoise calibrate --resume runs/go2

    Args:
        dry_run: Print the whole plan (postures, joint ranges, torques, duration) and move nothing.
        resume: Resume the run in this folder after its last complete trial, with its own settings; no others are allowed.
        out: Run folder; default runs/ROBOT-TIME.
    """
    from equipoise.calibration.routine import check
    from equipoise.cli.session import confirm, new_run, run_path
    from equipoise.result.requirements import read_requirements, verdicts

    del resume  # handled by `_resume`
    required = read_requirements(fail_unless)
    output.check()
    model = load_robot(robot or _DEFAULT_ROBOT, description)
    if not dry_run:
        model = with_imu_pose(model, target.simulated)
    check(model, method)
    if dry_run:
        standing = isinstance(target, SimulatedTarget) and target.start == "standing"
        show_rehearsal(model, method, target.platform, output.json, standing)
        if (reason := imu_pose_missing(model, target.simulated)) is not None:
            print_message(f"before the run: {reason}")
        return 0
    confirm(target, model, method)
    out = run_path(model, out)
    with new_run(target, model, out, method) as run:
        if not output.silent:  # settings that the simulation refuses are refused before
            _print_settings(robot, target, method, out)
            print_message(model.imu.line)
        with output.viewing(run.folder):
            result = run(output.silent)
            output.show(result, run.folder)
    return exit_code(required, verdicts(result.composite, result.checks))


def _resume(
    robot: RobotOrNone = None,
    *,
    resume: Path,
    yes: Flag = False,
    output: ShownFlags,
) -> None:
    """Resume a run after its last complete trial, with its own settings, and show its
    result.

    Args:
        resume: Folder of the run.
        yes: On a robot: start without confirmation.
    """
    if robot is not None:
        raise SettingsError("--resume uses the settings of the run; a robot cannot be given with it")
    header = read_header(resume)
    from equipoise.calibration.run_folder import RunFolder
    from equipoise.cli.session import confirm, resumed_run

    folder = RunFolder(resume, header)
    output.check()
    if folder.complete:
        print(f"the run in {resume} is complete; this is its result", file=sys.stderr)
        with output.viewing(folder):
            output.show(folder.shown(), folder)
        return
    model, method, target = folder.robot(), folder.method(), RunTarget.of(folder)
    confirm(target, model, method, yes)
    with resumed_run(target, model, resume, method) as run, output.viewing(run.folder):
        output.show(run(output.silent), run.folder)


def calibrate_for(arguments: Sequence[str]) -> Verb:
    """Return `calibrate`, or the function for --resume; raises SettingsError for flags that --resume excludes."""
    if {"--help", "-h"} & {*arguments} or not chosen(arguments, "--resume", ""):
        return calibrate
    allowed = {"--resume", "--yes", "--no-report", *(f"--{flag.name}" for flag in dataclasses.fields(ShownFlags))}
    for flag in (word.partition("=")[0] for word in arguments if word.startswith("--")):
        if flag not in allowed:
            raise SettingsError(f"--resume uses the settings of the run; {flag} cannot be given with it")
    return _resume


def show_rehearsal(model: RobotModel, method: Method, platform: str, json: bool, standing: bool = False) -> None:
    """Print the plan of a calibration.

    Args:
        standing: true if the robot stands at the start and the end.
    """
    from equipoise.calibration.rehearsal import rehearse
    from equipoise.drivers.platforms import for_platform
    from equipoise.terminal.robot_reports import print_rehearsal

    rehearsal = rehearse(for_platform(platform, model), method, standing)
    if json:
        table = {"schema": "equipoise.rehearsal/1", "platform": platform, **rehearsal.to_dict()}
        table["imu"] = model.imu.to_dict()
        print(json_module.dumps(table, indent=2))
    else:
        print_rehearsal(rehearsal, platform)
        print(model.imu.line)


def _print_settings(robot: str | None, target: RunTarget, method: Method, out: Path) -> None:
    """Print the robot, platform and method of a run, defaults included, on stderr."""
    name = robot or f"{_DEFAULT_ROBOT} (default; for another: equipoise calibrate ROBOT)"
    where = f"on {target.platform}"
    if isinstance(target, SimulatedTarget):
        load = f", payload {target.payload}" if target.payload else ""
        where = f"simulated in {target.platform}, {target.world}{load}"
    print_message(f"{name}, {where}, method {method.name}, into {out}")
