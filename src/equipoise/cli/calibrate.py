"""`equipoise calibrate`."""

from __future__ import annotations

import json as json_module
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import arg

from equipoise.cli.flags import (
    Described,
    Duration,
    File,
    Hertz,
    Kilograms,
    Metres,
    PlatformName,
    RobotOrNone,
    Seconds,
    Setting,
    Verbose,
    load,
    seconds,
)
from equipoise.cli.refusals import (
    refuse_flags_beside_resume,
    refuse_flags_of_other_methods,
    refuse_flags_of_other_platforms,
)
from equipoise.cli.session import Place, Session, confirm
from equipoise.cli.view import DEFAULT_PORT, RerunFile, ViewPort, Watch
from equipoise.errors import SettingsError
from equipoise.robot.description import RobotDescription
from equipoise.user_file import write_file

if TYPE_CHECKING:
    from equipoise.calibration.routine import CalibrationSettings
    from equipoise.calibration.run_folder import RunFolder
    from equipoise.recording.run_log_reader import LogContent
    from equipoise.result.calibration import Calibration

_DEFAULT_ROBOT = "unitree_a1"


def calibrate(
    robot: RobotOrNone = None,
    *,
    method: Literal["precise", "paper", "static"] = "precise",
    budget: Duration = None,
    mass: Kilograms = None,
    mass_sd: Kilograms = None,
    sway: bool = True,
    feet: Literal["measured", "commanded"] = "measured",
    noise: Literal["ideal", "realistic"] = "realistic",
    payload: Annotated[str | None, arg(metavar="M,X,Y,Z", help_behavior_hint="")] = None,
    start: Literal["standing", "lying"] = "standing",
    seed: int = 0,
    noise_seed: Annotated[int | None, arg(help_behavior_hint="")] = None,
    platform: PlatformName = "mujoco",
    set: Setting = (),
    settings: File = None,
    dry_run: bool = False,
    yes: bool = False,
    repeat: int = 1,
    tolerance: float = 0.005,
    lower: Metres = None,
    upper: Metres = None,
    t_thres: Seconds = None,
    lift_height: Metres = None,
    speed: float = 1.0,
    sway_amplitude: float = 0.05,
    sway_frequency: Hertz = None,
    sway_duration: Seconds = None,
    description_file: File = None,
    description: Described = RobotDescription(),  # noqa: B008
    out: File = None,
    resume: Annotated[Path | None, arg(metavar="RUN", help_behavior_hint="")] = None,
    view: bool = False,
    view_port: ViewPort = DEFAULT_PORT,
    rerun: RerunFile = None,
    report: bool = True,
    pictures: bool = True,
    json: bool = False,
    quiet: bool = False,
    verbose: Verbose = False,
    debug: bool = False,
) -> None:
    """Find a quadruped's mass, centre of mass and inertia, in simulation or on the robot.

    precise: the robot lifts two diagonal feet in many postures, at rest and turning its body, and feels how it tips; its
    sensors are calibrated on the way. paper: a bisection finds the planar centre of mass (Algorithms 1 and 2), sways give
    moments of inertia (equations 2 to 5). static: what the joint torques of the standing robot say.
    The run folder keeps every recording. On a robot a guard watches every command and sample, and lets it down on any trouble.

    Example: equipoise calibrate go2 --noise realistic --payload 1.5,0.1,0,0.08 --seed 3 --out runs/go2
             equipoise calibrate go2 --platform unitree-go2 --set interface=eth0
             equipoise calibrate --resume runs/go2

    Args:
        method: What to do.
        budget: precise: robot time, as 60s, 120s or 2min; default 120 s on an A1, more on larger robots.
        mass: precise: of the whole robot, from a scale [kg]; without it the mass comes from joint torques.
        mass_sd: precise: how sure the scale is [kg]; default 0.5 %.
        sway: precise: sway about all axes at the end unless this is given.
        feet: paper: support lines through the feet as the encoders measure them, or as they were commanded.
        noise: Sensor and actuator errors of the simulated robot; ideal has none, and no friction.
        payload: MASS,X,Y,Z or MASS,X,Y,Z,IXX,IYY,IZZ: kg, m in the base frame, kg m2 about its own CoM.
        start: How the simulated robot begins (and ends).
        seed: Of everything drawn.
        noise_seed: Of the noise alone, for several runs of one robot; default as --seed.
        set: A setting of the platform, as interface=eth0; may be given again.
        settings: TOML file with settings of the platform.
        dry_run: Print the whole plan (postures, joint ranges, torques, duration) and move nothing.
        yes: Robots: do not ask before the first motion.
        repeat: Calibrate so many times and report how much the results differ.
        tolerance: paper: the search ends when the bounds of the offset are this close [m].
        lower: paper: lower search bound of the offset [m]; default by the robot's size.
        upper: paper: upper search bound of the offset [m]; default by the robot's size.
        t_thres: paper: how long two feet stay up [s]; default by the robot's size.
        lift_height: paper: of the first lift [m]; default 5 % of the hip height.
        speed: paper: factor on the speed between trials.
        sway_amplitude: paper: of the sway [rad].
        sway_frequency: paper: of the sway [Hz]; default by the robot's size.
        sway_duration: paper: of the steady sway [s]; default six periods.
        description_file: TOML file with a robot description; flags win over it.
        out: Run folder; default runs/ROBOT-TIME.
        resume: Go on with the run in this folder behind its last complete trial, as it began: no other settings may be given.
        view: Open a page for the browser with the robot moving and the estimate closing in. At a terminal it stays until
            Enter or Ctrl-C; 'equipoise view RUN' shows any run again. The control loop does not wait for it.
        view_port: Of the page, which is for this computer alone: docs/view.md says how to look from another one.
        rerun: Write the same for Rerun when the run is over.
        report: The page report.html is written into the run folder unless this is given.
        pictures: PNG pictures are drawn unless this is given.
        json: Print the result as one JSON object and nothing else on stdout.
        quiet: No progress.
        verbose: Show how long each stage of the estimate took.
        debug: Show a traceback if something goes wrong.
    """
    given = locals()
    watch = Watch(view, view_port, rerun)
    shown = _Shown(report, pictures, json, verbose)
    if resume is not None:
        refuse_flags_beside_resume(calibrate, given)
        _resumed(resume, yes, quiet or json, watch, shown)
        return
    refuse_flags_of_other_methods(calibrate, method, given)
    refuse_flags_of_other_platforms(calibrate, platform, given)
    from equipoise.calibration.routine import CalibrationSettings, check
    from equipoise.drivers.catalog import given_settings
    from equipoise.experiments.sway import SwaySettings
    from equipoise.paper.trial_runner import ComSearchSettings
    from equipoise.precise.routine import PreciseSettings
    from equipoise.simulation.payload import Payload

    plan = CalibrationSettings(
        method,
        feet,
        ComSearchSettings(lower, upper, tolerance, lift_height, t_thres, speed),
        SwaySettings(sway_amplitude, sway_frequency, sway_duration),
        PreciseSettings(seconds(budget), mass, mass_sd, sway),
    )
    if payload is not None:
        Payload.parse(payload)
    if repeat < 1:
        raise SettingsError(f"--repeat is {repeat}; it must be 1 or more")
    if repeat > 1 and rerun is not None:
        raise SettingsError(
            "--rerun writes one run; with --repeat use 'equipoise view RUN --rerun FILE.rrd' afterwards"
        )
    watch.check()
    model = load(robot or _DEFAULT_ROBOT, description_file, description)
    place = Place(platform, given_settings(set, settings), noise, payload, seed, start, noise_seed)
    check(model, plan)
    if dry_run:
        from equipoise.calibration.rehearsal import rehearse
        from equipoise.terminal.platform import print_rehearsal

        rehearsal = rehearse(model, plan)
        if json:
            table = {"schema": "equipoise.rehearsal/1", "platform": platform, **rehearsal.to_dict()}
            print(json_module.dumps(table, indent=2))
        else:
            print_rehearsal(rehearsal, platform)
        return
    confirm(place, model, plan, yes)
    now = datetime.now(timezone.utc)
    out = out or Path("runs") / f"{model.name}-{now:%Y%m%d-%H%M%S-%f}"
    facts = {"time": now.isoformat(timespec="seconds")}
    if not (quiet or json):
        _say_what(robot, place, plan, out)
    with Session(place, model) as session:
        if repeat == 1:
            folder = _begun(session, out, plan, facts)
            with watch.over(folder, quiet or json):
                shown.show(_run(session, folder, plan, quiet or json), folder)
        else:
            _repeated(session, out, plan, facts, repeat, report, quiet or json, json, watch)


def _say_what(robot: str | None, place: Place, plan: CalibrationSettings, out: Path) -> None:
    """What is about to be done: nobody has to guess what the defaults are."""
    whose = robot or f"{_DEFAULT_ROBOT} (name another, or a URDF or MJCF file)"
    where = f"simulated in {place.platform}, sensors {place.noise}" if place.simulated else f"on {place.platform}"
    load = f", payload {place.payload}" if place.payload else ""
    print(f"{whose}, {where}{load}, method {plan.method}, into {out}", file=sys.stderr)


def _begun(session: Session, out: Path, plan: CalibrationSettings, facts: Mapping[str, Any]) -> RunFolder:
    """The folder of a run that is about to be made."""
    from equipoise.calibration.run_folder import RunFolder

    return RunFolder.create(out, session.robot, plan, {**facts, **session.facts})


def _run(
    session: Session, folder: RunFolder, plan: CalibrationSettings, quiet: bool, content: LogContent | None = None
) -> Calibration:
    """One run, its result on disk."""
    result = session.run(folder, plan, quiet, content)
    folder.save(result)
    return result


def _resumed(path: Path, yes: bool, quiet: bool, watch: Watch, shown: _Shown) -> None:
    """Go on with a run, and show its result."""
    from equipoise.calibration.run_folder import RunFolder

    folder = RunFolder.open(path)
    watch.check()
    if folder.complete:
        print(f"the run in {path} is complete; this is what its recordings say", file=sys.stderr)
        with watch.over(folder, quiet):
            shown.show(folder.estimate(), folder)
        return
    model, plan, place = folder.robot(), folder.settings(), Place.of(folder)
    confirm(place, model, plan, yes)
    with Session(place, model) as session:
        folder, content = RunFolder.resume(path, repeats=place.simulated)
        with watch.over(folder, quiet):
            shown.show(_run(session, folder, plan, quiet, content), folder)


def _repeated(
    session: Session,
    out: Path,
    plan: CalibrationSettings,
    facts: Mapping[str, Any],
    count: int,
    report: bool,
    quiet: bool,
    json: bool,
    watch: Watch,
) -> None:
    """Several runs on one robot, and how much they differ."""
    from equipoise.calibration.repeatability import repeatability, to_dict
    from equipoise.report.page import REPORT, save_comparison, save_report
    from equipoise.terminal.repeatability import print_repeatability

    results: dict[str, Calibration] = {}
    for number in range(count):
        if not quiet:
            print(f"calibration {number + 1} of {count}", file=sys.stderr)
        folder = _begun(session, out / f"{number + 1:02d}", plan, {**facts, "repetition": number})
        with watch.over(folder, quiet, stays=number + 1 == count):
            result = _run(session, folder, plan, quiet)
        results[folder.path.name] = result
        if report:
            save_report(result, folder.path)
    repeated = repeatability(list(results.values()))
    table = to_dict(repeated, count)
    write_file(out / "repeatability.json", json_module.dumps(table, indent=2) + "\n")
    if report:
        save_comparison(results, out)
    if json:
        print(json_module.dumps(table, indent=2))
    else:
        print_repeatability(session.robot.name, repeated, count)
        print(f"saved: {out}" + (f"\nsee {out / REPORT}" if report else ""))


@dataclass(frozen=True)
class _Shown:
    """How a result is shown."""

    report: bool
    pictures: bool
    json: bool
    verbose: bool

    def show(self, result: Calibration, folder: RunFolder) -> None:
        """Draw and print it."""
        from equipoise.terminal.calibration import print_calibration

        files = [folder.path / "calibration.json"]
        if self.pictures:
            from equipoise.pictures.files import save_pictures

            files += save_pictures(result, folder.path)
        if self.report:
            from equipoise.report.page import save_report

            files.append(save_report(result, folder.path))
        if self.json:
            print(result.to_json(), end="")
        else:
            print_calibration(result, files, self.verbose, folder.path)
