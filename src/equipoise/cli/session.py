"""Calibration on a platform, with confirmation before a real robot moves, saved in a run folder."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

from equipoise.calibration.rehearsal import rehearse
from equipoise.calibration.run_folder import RunFolder
from equipoise.cli.operator_prompt import Keyboard
from equipoise.cli.target import HardwareTarget, RunTarget, SimulatedTarget
from equipoise.drivers.checkup import examine
from equipoise.drivers.platforms import for_platform, open_platform
from equipoise.errors import EquipoiseError, MotionError, SettingsError
from equipoise.method.method import Method
from equipoise.platform.logged_platform import Logged
from equipoise.platform.platform import Platform
from equipoise.platform.resumed import RepeatedSimulation, ResumedRobot
from equipoise.recording.run_log_reader import LogContent
from equipoise.result.calibration import Calibration
from equipoise.robot.model import RobotModel
from equipoise.terminal.results import TrialProgress
from equipoise.terminal.robot_reports import rehearsal_lines
from equipoise.user_file import typed

if TYPE_CHECKING:
    from equipoise.guard.report import GuardReport

_MASS_TOLERANCE = 0.03  # of the robot's mass
_CHECK_TIME = 1.0  # [s] before the operator confirms


class Session:
    """Run on a platform; calling it performs the calibration.

    Args:
        target: platform with its settings.
        robot: model of the robot.
        method: method with its settings.
    """

    folder: RunFolder
    content: LogContent | None = None  # of a resumed run

    def __init__(self, target: RunTarget, robot: RobotModel, method: Method) -> None:
        self.target, self.robot, self.method = target, for_platform(target.platform, robot), method
        self._simulation = target.simulate(robot) if isinstance(target, SimulatedTarget) else None
        self._report: GuardReport | None = None  # of a real robot, after the motion

    def __enter__(self) -> Session:
        return self

    def __exit__(self, kind: type[BaseException] | None, *exception: object) -> None:
        if self._simulation is not None:
            self._simulation.platform.close()

    @property
    def facts(self) -> Mapping[str, Any]:
        """Provenance of the run."""
        engine = {} if self._simulation is None else {self.target.platform: self._simulation.engine_version}
        return {**self.target.facts(), **engine}

    def __call__(self, quiet: bool) -> Calibration:
        """Perform one calibration, save its result and return it."""
        from equipoise.calibration.routine import perform, with_guard_report

        folder, content, method = self.folder, self.content, self.method
        with folder:
            if self._simulation is not None:
                folder.save_truth(self._simulation.truth, self._simulation.truth_of_parts)
                _warn_about_mass(method, self._simulation.truth.composite.mass)
            with TrialProgress(quiet) as progress:
                with self._platform() as (platform, keyboard):
                    confirm = keyboard.confirmed if sys.stdin.isatty() else None
                    if content is not None and content.recordings:  # confirmed when the run began
                        confirm = _confirmed_before
                    real = self._simulation is None
                    rotated, on_response = (keyboard.rotation_confirmed, folder.save_response) if real else (None, None)
                    experiment = perform(
                        platform, self.robot, method, folder.keep, progress.update, rotated, confirm, on_response
                    )
                result = experiment.estimate(method, progress.update)
        result = result.with_provenance(**folder.provenance)
        if self._simulation is not None:
            result = result.with_truth(self._simulation.truth).with_truth_of_parts(self._simulation.truth_of_parts)
        elif self._report is not None:
            result = with_guard_report(result, self._report)
        folder.save(result)
        return result

    @contextmanager
    def _platform(self) -> Generator[tuple[Platform, Keyboard]]:
        """Yield the platform that the routine moves, and the operator's keyboard."""
        folder, content = self.folder, self.content
        if self._simulation is not None:
            bare = self._simulation.platform
            logged = Logged(bare, folder.log)
            yield (logged if content is None else RepeatedSimulation(logged, bare, content)), Keyboard()
            return
        from equipoise.guard.remote_robot import RemoteRobot

        assert isinstance(self.target, HardwareTarget)
        ending = folder.path / "ending.txt"
        remote = RemoteRobot(self.target.platform, self.robot, self.target.given, folder.log, ending)
        for line in (f"robot process: {remote.realtime}", remote.warning):
            if line:
                print(line, file=sys.stderr)
        try:
            with remote, Keyboard(remote.stop) as keyboard:
                yield (remote if content is None else ResumedRobot(remote, content)), keyboard
        finally:
            self._report = remote.report()
            _print_guard_report(self._report)


def run_path(robot: RobotModel, out: Path | None) -> Path:
    """Return the requested run folder, or one named by robot and time."""
    return out or Path("runs") / f"{robot.name}-{datetime.now(timezone.utc):%Y%m%d-%H%M%S-%f}"


@contextmanager
def new_run(target: RunTarget, robot: RobotModel, out: Path, method: Method) -> Generator[Session]:
    """Open a session in the new run folder `out`."""
    time = datetime.now(timezone.utc).isoformat(timespec="seconds")
    with Session(target, robot, method) as session:
        session.folder = RunFolder.create(out, session.robot, method, {"time": time, **session.facts})
        with _resume_hint(session.folder):
            yield session


@contextmanager
def resumed_run(target: RunTarget, robot: RobotModel, path: Path, method: Method) -> Generator[Session]:
    """Open a session that resumes the run in a folder after its last complete trial."""
    with Session(target, robot, method) as session:
        session.folder, session.content = RunFolder.resume(path, repeats=target.simulated)
        with _resume_hint(session.folder):
            yield session


@contextmanager
def _resume_hint(folder: RunFolder) -> Generator[None]:
    """If the run is interrupted, print the folder of its recordings and the command that resumes it.

    A run whose mass is not confirmed is deleted: nothing was recorded yet.
    """
    log = folder.log  # a closed folder has none
    try:
        yield
    except SettingsError as error:
        if "mass_comparison" in error.details:
            folder.discard()
        raise
    except (KeyboardInterrupt, EquipoiseError):
        if not log.empty:
            print(f"completed trials are saved in {folder.path}", file=sys.stderr)
            print(f"resume: equipoise calibrate --resume {typed(folder.path)}", file=sys.stderr)
        raise


def _confirmed_before(question: str) -> bool:
    """Return True: the operator answered the question before the first lift of the run."""
    del question
    return True


def confirm(target: RunTarget, robot: RobotModel, method: Method, yes: bool = False) -> None:
    """Check a real robot, print the plan and ask for confirmation, before anything moves.

    Args:
        yes: true to start without confirmation, as does the platform's `yes`.

    Raises:
        SettingsError: the operator does not confirm.
        MotionError: a serious check fails and `yes` is given.
    """
    if not isinstance(target, HardwareTarget):
        return

    robot = for_platform(target.platform, robot)
    with open_platform(target.platform, robot, target.given) as connection:
        wrong = [finding for finding in examine(connection, robot, _CHECK_TIME) if finding.fine is False]
    for line in rehearsal_lines(rehearse(robot, method), target.platform):
        print(line, file=sys.stderr)
    for finding in wrong:
        print(f"check failed: {finding.name}: {finding.value}; {finding.advice}", file=sys.stderr)
    yes = yes or target.yes
    if yes and (serious := [finding for finding in wrong if finding.serious]):
        raise MotionError(
            f"{serious[0].name}: {serious[0].value}; {serious[0].advice} (see 'equipoise doctor'; without --yes you are asked)"
        )
    if yes:
        return
    print(
        "Keep clear of the robot, with a hand on the emergency stop. Ctrl-C lowers the robot at any time; the space bar "
        "damps its joints immediately, and it sinks.\n"
        f"Type {robot.name} to begin: ",
        end="", file=sys.stderr, flush=True,
    )  # fmt: skip
    if sys.stdin.readline().strip() != robot.name:
        raise SettingsError(f"not confirmed, nothing was moved; type {robot.name}, or pass --yes in a script")


def _warn_about_mass(method: Method, mass: float) -> None:
    """Warn if --mass contradicts the mass of the simulated robot [kg]."""
    given = getattr(getattr(method, "base", method), "mass", None)  # of a combined method, its base method
    if given is not None and abs(given / mass - 1) > _MASS_TOLERANCE:
        warnings.warn(f"--mass is {given:g} kg, but the simulated robot has {mass:.2f} kg", stacklevel=2)


def _print_guard_report(report: Any) -> None:
    words = [f"guard: {report.commands} commands"]
    if report.overruns is not None:
        words.append(f"{report.overruns} more than 1 ms late")
    words.append(f"largest tilt {report.largest_tilt * 57.3:.0f} deg")
    if report.hottest_motor is not None:
        words.append(f"hottest motor {report.hottest_motor:.0f} deg C")
    print(f"{', '.join(words)}; at the end: {', '.join(report.ending) or 'nothing was moved'}", file=sys.stderr)
    if report.trouble:
        print(f"guard: {report.trouble}", file=sys.stderr)
