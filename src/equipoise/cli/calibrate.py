"""`equipoise calibrate`."""

from __future__ import annotations

import json as json_module
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import arg

from equipoise.cli.flags import (
    ContactsName,
    Count,
    Described,
    File,
    Flag,
    NoiseName,
    Output,
    PlatformName,
    Required,
    RobotFlags,
    RobotOrNone,
    SettingsGiven,
    Verbose,
    WithEffects,
    WithoutEffects,
    exit_code,
    interruption_told,
    load,
)
from equipoise.cli.methods import method_asked_for, method_flags, owners, read_method, refuse_flags_of_other_methods
from equipoise.cli.operator_prompt import with_known_imu
from equipoise.cli.report import if_installed
from equipoise.cli.session import Place, Session, confirm
from equipoise.cli.settings import Verb, chosen, flag_types, shaped, unknown_flags
from equipoise.cli.view import Watch
from equipoise.errors import SettingsError
from equipoise.user_file import write_file

if TYPE_CHECKING:
    from equipoise.calibration.run_folder import RunFolder
    from equipoise.method.method import Method
    from equipoise.recording.run_log_reader import LogContent
    from equipoise.result.calibration import Calibration
    from equipoise.robot.model import RobotModel

_DEFAULT_ROBOT = "unitree_a1"
DEFAULT_PLATFORM = "mujoco"


@dataclass(frozen=True)
class SimulationFlags:
    """The simulated robot. 'equipoise calibrate --platform NAME --help' shows the flags of a real one.

    Attributes:
        payload: MASS,X,Y,Z or MASS,X,Y,Z,IXX,IYY,IZZ: kg, m in the base frame, kg m2 about its own CoM.
        start: How the simulated robot begins (and ends).
        seed: Of everything drawn.
        noise_seed: Of the noise alone, for several runs of one robot; default as --seed.
    """

    platform: PlatformName = "mujoco"
    noise: NoiseName = "realistic"
    effects: WithEffects = ()
    without: WithoutEffects = ()
    contacts: ContactsName = "own"
    payload: Annotated[str | None, arg(metavar="M,X,Y,Z", help_behavior_hint="")] = None
    start: Literal["standing", "lying"] = "standing"
    seed: int = 0
    noise_seed: Count = None

    def place(self) -> Place:
        """Where the run happens; raises SettingsError."""
        from equipoise.robot.scale import Scale
        from equipoise.simulation.effects import read_effects, read_names
        from equipoise.simulation.payload import Payload
        from equipoise.simulation.simulation import sizes_of

        if self.payload is not None:
            Payload.parse(self.payload)
        effects, without = read_effects(self.effects), read_names(self.without)
        # Before anything takes long: what there is not, and what the engine cannot have.
        sizes_of(self.noise, Scale(1.0, 1.0), effects, without).refuse_what_lacks(self.platform)
        return Place(
            self.platform, {}, self.noise, self.payload, self.seed, self.start, self.noise_seed, effects, without,
            self.contacts,
        )  # fmt: skip


@dataclass(frozen=True)
class PlatformFlags:
    """The real robot.

    Attributes:
        set: A setting of the platform, as interface=eth0; may be given again.
        settings: TOML file with settings of the platform.
        yes: Do not ask before the first motion.
    """

    platform: PlatformName = "mujoco"
    set: SettingsGiven = ()
    settings: File = None
    yes: Flag = False

    def place(self) -> Place:
        """Where the run happens; raises SettingsError."""
        from equipoise.drivers.platforms import given_settings

        return Place(self.platform, given_settings(self.set, self.settings))


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

    @property
    def watch(self) -> Watch:
        """Settings of the view beside the run."""
        return Watch(self.view, self.browser)

    def show(self, result: Calibration, folder: RunFolder) -> None:
        """Draw and print a result."""
        from equipoise.terminal.calibration import print_calibration

        files = [folder.path / "calibration.json"]
        if self.report:
            files += if_installed(_page, result, folder.path)
        if self.json:
            print(result.to_json(), end="")
        else:
            print_calibration(result, files, self.verbose, folder.path)


def _page(result: Calibration, folder: Path) -> list[Path]:
    from equipoise.report.page import save_report

    return [save_report(result, folder)]


def _comparison(results: dict[str, Calibration], folder: Path) -> list[Path]:
    from equipoise.report.page import save_comparison

    return [save_comparison(results, folder)]


@dataclass(frozen=True)
class RunFlags(ShownFlags):
    """What is written and shown.

    Attributes:
        out: Run folder; default runs/ROBOT-TIME.
        require: End with 11 where the result is less than that, as identified,checks: all that the method estimates is
            identified; all checks passed; or com_x, com_y and other quantities are identified.
    """

    out: File = None
    require: Required = None


def calibrate(
    robot: RobotOrNone = None,
    *,
    dry_run: Flag = False,
    repeat: Annotated[int, arg(metavar="N")] = 1,
    resume: Annotated[Path | None, arg(metavar="RUN", help_behavior_hint="")] = None,
    method: Any = None,
    description: Described = RobotFlags(),  # noqa: B008
    place: Any = None,
    output: RunFlags = RunFlags(),
) -> int:
    """Find a quadruped's mass, centre of mass and inertia, in simulation or on the robot.

    The run folder keeps every recording. On a robot a guard watches every command and sample, and lets it down on any trouble.

    Example: equipoise calibrate go2 --noise realistic --payload 1.5,0.1,0,0.08 --seed 3 --out runs/go2
             equipoise calibrate go2 --noise stress --without springs --with cable=0.5
             equipoise calibrate go2 --platform unitree-go2 --set interface=eth0
             equipoise calibrate --resume runs/go2

    Args:
        dry_run: Print the whole plan (postures, joint ranges, torques, duration) and move nothing.
        repeat: Calibrate so many times and report how much the results differ.
        resume: Go on with the run in this folder behind its last complete trial, as it began: no other settings may be given.
    """
    from equipoise.calibration.routine import check
    from equipoise.result.requirements import read_requirements, verdicts

    del resume  # a run that is gone on with is what `_resume` does
    asked, where, required = read_method(method), place.place(), read_requirements(output.require)
    if repeat < 1:
        raise SettingsError(f"--repeat is {repeat}; it must be 1 or more")
    output.watch.check()
    model = load(robot or _DEFAULT_ROBOT, description)
    if not dry_run:
        model = with_known_imu(model, where.simulated)
    check(model, asked)
    if dry_run:
        rehearsed(model, asked, where.platform, output.json)
        return 0
    confirm(where, model, asked, getattr(place, "yes", True))
    now = datetime.now(timezone.utc)
    out = output.out or Path("runs") / f"{model.name}-{now:%Y%m%d-%H%M%S-%f}"
    facts = {"time": now.isoformat(timespec="seconds")}
    if not output.silent:
        _say_what(robot, where, asked, out)
        print(model.imu.sentence, file=sys.stderr)
    if repeat > 1:
        results = _repeated(model, where, out, asked, facts, repeat, output)
    else:
        with Session(where, model) as session:
            folder = begun(session, out, asked, facts)
            with interruption_told(folder), output.watch.over(folder):
                results = [run_into(session, folder, asked, output.silent)]
                output.show(results[0], folder)
    return max(exit_code(required, verdicts(result.composite, result.checks)) for result in results)


def _resume(
    robot: RobotOrNone = None,
    *,
    resume: Path,
    yes: Flag = False,
    output: ShownFlags = ShownFlags(),
) -> None:
    """Go on with a run behind its last complete trial, as it began, and show its result.

    Args:
        resume: Folder of the run.
        yes: Robots: do not ask before the first motion.
    """
    from equipoise.calibration.run_folder import RunFolder

    if robot is not None:
        raise SettingsError("--resume goes on as the run began; a robot cannot be given with it")
    folder = RunFolder.open(resume)
    output.watch.check()
    if folder.complete:
        print(f"the run in {resume} is complete; this is what its recordings say", file=sys.stderr)
        with output.watch.over(folder):
            output.show(folder.shown(), folder)
        return
    model, method, place = folder.robot(), folder.method(), Place.of(folder)
    confirm(place, model, method, yes)
    with Session(place, model) as session:
        folder, content = RunFolder.resume(resume, repeats=place.simulated)
        with interruption_told(folder), output.watch.over(folder):
            output.show(run_into(session, folder, method, output.silent, content), folder)


def calibrate_for(arguments: Sequence[str]) -> Verb:
    """`calibrate` with the flags of the method and the platform that are asked for; or what goes on with a run.

    Raises:
        SettingsError: a flag belongs to another method or another kind of platform.
    """
    name = method_asked_for(arguments)
    verbs = _by_place(calibrate, method=method_flags(name, arguments))
    if "--help" not in arguments and chosen(arguments, "--resume", ""):
        for flag in unknown_flags(_resume, arguments):
            if owners(flag) or any(flag in flag_types(verb) for verb in verbs.values()):
                raise SettingsError(
                    f"--resume goes on as the run began; --{flag.replace('_', '-')} cannot be given with it"
                )
        return _resume
    verb = _at_place(verbs, arguments)
    refuse_flags_of_other_methods(verb, arguments, f"--method {name}")
    return verb


def placed(verb: Verb, arguments: Sequence[str], method: Any) -> Verb:
    """A verb that calibrates, with the flags of the platform that is asked for.

    Args:
        method: class of the method's flags.

    Raises:
        SettingsError: a flag belongs to another kind of platform.
    """
    return _at_place(_by_place(verb, method), arguments)


def _by_place(verb: Verb, method: Any) -> dict[str, Verb]:
    kinds = {"simulators": ("simulation", SimulationFlags), "real robots": ("platform", PlatformFlags)}
    return {
        kind: shaped(verb, method=method, place=Annotated[place, arg(name=name)])
        for kind, (name, place) in kinds.items()
    }


def _at_place(verbs: Mapping[str, Verb], arguments: Sequence[str]) -> Verb:
    platform = chosen(arguments, "--platform", DEFAULT_PLATFORM)
    own = verbs["simulators" if Place(platform).simulated else "real robots"]
    for flag in unknown_flags(own, arguments):
        for kind, verb in verbs.items():
            if flag in flag_types(verb):
                raise SettingsError(f"--{flag.replace('_', '-')} is for {kind}; {platform} is none")
    return own


def rehearsed(model: RobotModel, method: Method, platform: str, json: bool) -> None:
    """Print what a calibration would do."""
    from equipoise.calibration.rehearsal import rehearse
    from equipoise.terminal.platform import print_rehearsal

    rehearsal = rehearse(model, method)
    if json:
        table = {"schema": "equipoise.rehearsal/1", "platform": platform, **rehearsal.to_dict()}
        table["imu"] = model.imu.to_dict()
        print(json_module.dumps(table, indent=2))
    else:
        print_rehearsal(rehearsal, platform)
        print(f"{model.imu.sentence}.")


def _say_what(robot: str | None, place: Place, method: Method, out: Path) -> None:
    """What is about to be done: nobody has to guess what the defaults are."""
    whose = robot or f"{_DEFAULT_ROBOT} (name another, or a URDF or MJCF file)"
    where = f"simulated in {place.platform}, {place.world}" if place.simulated else f"on {place.platform}"
    load = f", payload {place.payload}" if place.payload else ""
    print(f"{whose}, {where}{load}, method {method.name}, into {out}", file=sys.stderr)


def begun(session: Session, out: Path, method: Method, facts: Mapping[str, Any]) -> RunFolder:
    """The folder of a run that is about to be made."""
    from equipoise.calibration.run_folder import RunFolder

    return RunFolder.create(out, session.robot, method, {**facts, **session.facts})


def run_into(
    session: Session, folder: RunFolder, method: Method, quiet: bool, content: LogContent | None = None
) -> Calibration:
    """One run, its result on disk."""
    result = session.run(folder, method, quiet, content)
    folder.save(result)
    return result


def _repeated(
    model: RobotModel,
    place: Place,
    out: Path,
    method: Method,
    facts: Mapping[str, Any],
    count: int,
    output: RunFlags,
) -> list[Calibration]:
    """Several runs on one robot, and how much they differ; each is whole by itself, and can be gone on with."""
    from equipoise.calibration.repeatability import repeatability, to_dict
    from equipoise.terminal.repeatability import print_repeatability

    results: dict[str, Calibration] = {}
    for number in range(count):
        if not output.silent:
            print(f"calibration {number + 1} of {count}", file=sys.stderr)
        with Session(place.again(number), model) as session:
            folder = begun(session, out / f"{number + 1:02d}", method, {**facts, "repetition": number})
            with interruption_told(folder), output.watch.over(folder, stays=number + 1 == count):
                result = run_into(session, folder, method, output.silent)
        results[folder.path.name] = result
        if output.report:
            if_installed(_page, result, folder.path)
    repeated = repeatability(list(results.values()))
    table = to_dict(repeated, count)
    write_file(out / "repeatability.json", json_module.dumps(table, indent=2) + "\n")
    page = if_installed(_comparison, results, out) if output.report else []
    if output.json:
        print(json_module.dumps(table, indent=2))
    else:
        print_repeatability(model.name, repeated, count)
        print(f"saved: {out}" + "".join(f"\nsee {file}" for file in page))
    return [*results.values()]
