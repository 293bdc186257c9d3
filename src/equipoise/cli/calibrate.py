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
from equipoise.cli.arguments import chosen
from equipoise.cli.flags import Described, File, Flag, Output, Required, RobotOrNone, Verbose, exit_code
from equipoise.cli.methods import METHOD_FLAGS
from equipoise.cli.operator_prompt import with_known_imu
from equipoise.cli.parsing import ChosenFlags, Verb
from equipoise.cli.report import try_to_save
from equipoise.cli.target import TARGET_FLAGS, RunTarget, SimulatedTarget
from equipoise.cli.view import viewer_of
from equipoise.errors import SettingsError
from equipoise.method.method import Method
from equipoise.robot.catalog import load_robot
from equipoise.user_file import write_file

if TYPE_CHECKING:
    from equipoise.calibration.run_folder import RunFolder
    from equipoise.result.calibration import Calibration
    from equipoise.robot.model import RobotModel

_ELSEWHERE = "; 'equipoise report {}' draws the page elsewhere"
_DEFAULT_ROBOT = "unitree_a1"
CHOSEN: dict[type, ChosenFlags] = {Method: METHOD_FLAGS, RunTarget: TARGET_FLAGS}


@dataclass(frozen=True)
class ShownFlags(Output):
    """What is shown of a run and its result.

    Attributes:
        view: Show the robot moving and the estimate converging in a Rerun window, or, without a display, record view.rrd in
            the run folder. 'equipoise view RUN' shows any run again. The control loop does not wait for it.
        browser: With --view: serve the viewer to a browser. At a terminal it is served until Enter or Ctrl-C.
        report: Leave out the page report.html in the run folder.
        verbose: Show how long each stage of the estimate took.
    """

    view: Flag = False
    browser: Flag = False
    report: Flag = True
    verbose: Verbose = False

    def check(self) -> None:
        """Refuse a view that will not work, before anything moves.

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
    def viewing(self, folder: RunFolder, stays: bool = True) -> Generator[None]:
        """Show a run while it is written into a folder; `stays`: a page is served after it, until Enter or Ctrl-C."""
        if not self.view:
            yield
            return
        with viewer_of(folder, self.browser, stays):
            yield

    def show(self, result: Calibration, folder: RunFolder) -> None:
        """Draw and print a result."""
        from equipoise.terminal.results import print_calibration

        files = [folder.path / "calibration.json"]
        if self.report:
            files += try_to_save(result, folder.path, _ELSEWHERE.format(folder.path))
        if self.json:
            print(result.to_json(), end="")
        else:
            print_calibration(result, files, self.verbose, folder.path)


def calibrate(
    robot: RobotOrNone = None,
    *,
    dry_run: Flag = False,
    repeat: Annotated[int, arg(metavar="N")] = 1,
    resume: Annotated[Path | None, arg(metavar="RUN", help_behavior_hint="")] = None,
    out: File = None,
    fail_unless: Required = None,
    method: Method,
    description: Described,
    place: Annotated[RunTarget, arg(name="platform")],
    output: ShownFlags,
) -> int:
    """Find a quadruped's mass, centre of mass and inertia, in simulation or on the
    robot.

    The run folder keeps every recording. On a robot a guard watches every command
    and sample, and lets it down on any trouble.

    Example: equipoise calibrate a1 --payload 1.5,0.1,0,0.08 --seed 3 --out runs/a1
             equipoise calibrate go2 --sim-preset stress --disable-effect springs --enable-effect cable=0.5
             equipoise calibrate go2 --platform unitree-go2 --set interface=eth0
             equipoise calibrate --resume runs/go2

    Args:
        dry_run: Print the whole plan (postures, joint ranges, torques, duration) and move nothing.
        repeat: Calibrate so many times and report how much the results differ.
        resume: Go on with the run in this folder behind its last complete trial, as it began: no other settings may be given.
        out: Run folder; default runs/ROBOT-TIME.
    """
    from equipoise.calibration.routine import check
    from equipoise.cli.session import confirm, new_run, run_path
    from equipoise.result.requirements import read_requirements, verdicts

    del resume  # a run that is gone on with is what `_resume` does
    required = read_requirements(fail_unless)
    if repeat < 1:
        raise SettingsError(f"--repeat is {repeat}; it must be 1 or more")
    output.check()
    model = load_robot(robot or _DEFAULT_ROBOT, description)
    if not dry_run:
        model = with_known_imu(model, place.simulated)
    check(model, method)
    if dry_run:
        rehearsed(model, method, place.platform, output.json)
        return 0
    confirm(place, model, method)
    out = run_path(model, out)
    if not output.silent:
        _say_what(robot, place, method, out)
        print(model.imu.message, file=sys.stderr)
    if repeat > 1:
        results = _repeated(model, place, out, method, repeat, output)
    else:
        with new_run(place, model, out, method) as run, output.viewing(run.folder):
            results = [run(output.silent)]
            output.show(results[0], run.folder)
    return max(exit_code(required, verdicts(result.composite, result.checks)) for result in results)


def _resume(
    robot: RobotOrNone = None,
    *,
    resume: Path,
    yes: Flag = False,
    output: ShownFlags,
) -> None:
    """Go on with a run behind its last complete trial, as it began, and show its
    result.

    Args:
        resume: Folder of the run.
        yes: Robots: do not ask before the first motion.
    """
    if robot is not None:
        raise SettingsError("--resume goes on as the run began; a robot cannot be given with it")
    header = read_header(resume)
    from equipoise.calibration.run_folder import RunFolder
    from equipoise.cli.session import confirm, resumed_run

    folder = RunFolder(resume, header)
    output.check()
    if folder.complete:
        print(f"the run in {resume} is complete; this is what its recordings say", file=sys.stderr)
        with output.viewing(folder):
            output.show(folder.shown(), folder)
        return
    model, method, place = folder.robot(), folder.method(), RunTarget.of(folder)
    confirm(place, model, method, yes)
    with resumed_run(place, model, resume, method) as run, output.viewing(run.folder):
        output.show(run(output.silent), run.folder)


def calibrate_for(arguments: Sequence[str]) -> Verb:
    """Return `calibrate`, or what goes on with a run; raises SettingsError for flags that cannot be given with it."""
    if {"--help", "-h"} & {*arguments} or not chosen(arguments, "--resume", ""):
        return calibrate
    taken = {"--resume", "--yes", "--no-report", *(f"--{flag.name}" for flag in dataclasses.fields(ShownFlags))}
    for flag in (word.partition("=")[0] for word in arguments if word.startswith("--")):
        if flag not in taken:
            raise SettingsError(f"--resume goes on as the run began; {flag} cannot be given with it")
    return _resume


def rehearsed(model: RobotModel, method: Method, platform: str, json: bool) -> None:
    """Print what a calibration would do."""
    from equipoise.calibration.rehearsal import rehearse
    from equipoise.terminal.robot_reports import print_rehearsal

    rehearsal = rehearse(model, method)
    if json:
        table = {"schema": "equipoise.rehearsal/1", "platform": platform, **rehearsal.to_dict()}
        table["imu"] = model.imu.to_dict()
        print(json_module.dumps(table, indent=2))
    else:
        print_rehearsal(rehearsal, platform)
        print(f"{model.imu.message}.")


def _say_what(robot: str | None, place: RunTarget, method: Method, out: Path) -> None:
    """What is about to be done: nobody has to guess what the defaults are."""
    whose = robot or f"{_DEFAULT_ROBOT} (name another, or a URDF or MJCF file)"
    where = f"on {place.platform}"
    if isinstance(place, SimulatedTarget):
        load = f", payload {place.payload}" if place.payload else ""
        where = f"simulated in {place.platform}, {place.world}{load}"
    print(f"{whose}, {where}, method {method.name}, into {out}", file=sys.stderr)


def _repeated(
    model: RobotModel, place: RunTarget, out: Path, method: Method, count: int, output: ShownFlags
) -> list[Calibration]:
    """Several runs on one robot, and how much they differ; each is whole by itself, and can be gone on with."""
    from equipoise.calibration.repeatability import repeatability, to_dict
    from equipoise.cli.session import new_run
    from equipoise.terminal.several_runs import print_repeatability

    results: dict[str, Calibration] = {}
    for number in range(count):
        if not output.silent:
            print(f"calibration {number + 1} of {count}", file=sys.stderr)
        folder, last = out / f"{number + 1:02d}", number + 1 == count
        again = new_run(place.again(number), model, folder, method, repetition=number)
        with again as run, output.viewing(run.folder, stays=last):
            results[folder.name] = run(output.silent)
        if output.report:
            try_to_save(results[folder.name], folder, _ELSEWHERE.format(folder))
    repeated = repeatability(list(results.values()))
    table = to_dict(repeated, count)
    write_file(out / "repeatability.json", json_module.dumps(table, indent=2) + "\n")
    page = try_to_save(results, out, _ELSEWHERE.format(out)) if output.report else []
    if output.json:
        print(json_module.dumps(table, indent=2))
    else:
        print_repeatability(model.name, repeated, count)
        print(f"saved: {out}" + "".join(f"\nsee {file}" for file in page))
    return [*results.values()]
