"""A calibration on its platform, confirmed where it moves a real robot, and kept in a run folder."""

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
from equipoise.errors import EquipoiseError, MotionError, SettingsError, UnconfirmedMassError
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

_ODD_SCALE = 0.03  # of the robot's mass
_LOOK_TIME = 1.0  # [s] at a robot before anybody is asked to confirm


class Session:
    """A run on its platform; calling it calibrates.

    Args:
        place: platform that the flags name, with its settings.
        robot: model of the robot.
        method: method with its settings.
    """

    folder: RunFolder
    content: LogContent | None = None  # of a run that is resumed

    def __init__(self, place: RunTarget, robot: RobotModel, method: Method) -> None:
        self.place, self.robot, self.method = place, for_platform(place.platform, robot), method
        self._simulation = place.simulate(robot) if isinstance(place, SimulatedTarget) else None
        self._report: GuardReport | None = None  # of a real robot, once it was put down

    def __enter__(self) -> Session:
        return self

    def __exit__(self, kind: type[BaseException] | None, *exception: object) -> None:
        if self._simulation is not None:
            self._simulation.platform.close()

    @property
    def facts(self) -> Mapping[str, Any]:
        """For a run's provenance."""
        engine = {} if self._simulation is None else {self.place.platform: self._simulation.engine}
        return {**self.place.facts(), **engine}

    def __call__(self, quiet: bool) -> Calibration:
        """Do one calibration; its result is on disk."""
        from equipoise.calibration.routine import perform, with_guard_report

        folder, content, method = self.folder, self.content, self.method
        with folder:
            if self._simulation is not None:
                folder.save_truth(self._simulation.truth, self._simulation.truth_of_parts)
                _question_scale(method, self._simulation.truth.composite.mass)
            with TrialProgress(quiet) as progress:
                with self._platform() as (platform, keyboard):
                    confirm = keyboard.confirmed if sys.stdin.isatty() else None
                    if content is not None and content.recordings:  # confirmed when the run began
                        confirm = _went_on
                    real = self._simulation is None
                    told, on_response = (keyboard.turned, folder.save_response) if real else (None, None)
                    experiment = perform(
                        platform, self.robot, method, folder.keep, progress.update, told, confirm, on_response
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
        """The platform that the routine moves, and the operator's keyboard."""
        folder, content = self.folder, self.content
        if self._simulation is not None:
            bare = self._simulation.platform
            logged = Logged(bare, folder.log)
            yield (logged if content is None else RepeatedSimulation(logged, bare, content)), Keyboard()
            return
        from equipoise.guard.remote_robot import RemoteRobot

        assert isinstance(self.place, HardwareTarget)
        ending = folder.path / "ending.txt"
        remote = RemoteRobot(self.place.platform, self.robot, self.place.given, folder.log, ending)
        for line in (f"robot process: {remote.realtime}", remote.warning):
            if line:
                print(line, file=sys.stderr)
        try:
            with remote, Keyboard(remote.stop) as keyboard:
                yield (remote if content is None else ResumedRobot(remote, content)), keyboard
        finally:
            self._report = remote.report()
            _tell_ending(self._report)


def run_path(robot: RobotModel, out: Path | None) -> Path:
    """Return the run folder that is asked for, or one by the robot's name and the time."""
    return out or Path("runs") / f"{robot.name}-{datetime.now(timezone.utc):%Y%m%d-%H%M%S-%f}"


@contextmanager
def new_run(place: RunTarget, robot: RobotModel, out: Path, method: Method, **facts: Any) -> Generator[Session]:
    """Open a session in a new run folder.

    Args:
        out: run folder.
        facts: provenance besides the time and that of the place.
    """
    time = datetime.now(timezone.utc).isoformat(timespec="seconds")
    with Session(place, robot, method) as session:
        session.folder = RunFolder.create(out, session.robot, method, {"time": time, **facts, **session.facts})
        with _interruption_told(session.folder):
            yield session


@contextmanager
def resumed_run(place: RunTarget, robot: RobotModel, path: Path, method: Method) -> Generator[Session]:
    """Open a session in the folder of a run that goes on behind its last complete trial."""
    with Session(place, robot, method) as session:
        session.folder, session.content = RunFolder.resume(path, repeats=place.simulated)
        with _interruption_told(session.folder):
            yield session


@contextmanager
def _interruption_told(folder: RunFolder) -> Generator[None]:
    """Say where the recordings are, and what goes on with them, if a run, or what shows it, does not come to its end."""
    log = folder.log  # which a folder that is closed no longer has
    try:
        yield
    except UnconfirmedMassError:
        folder.discard()
        raise
    except (KeyboardInterrupt, EquipoiseError):
        if not log.empty:
            print(f"what was measured so far is kept in {folder.path}", file=sys.stderr)
            print(f"go on: equipoise calibrate --resume {typed(folder.path)}", file=sys.stderr)
        raise


def _went_on(question: str) -> bool:
    """Confirm that a run goes on whose lifts have begun."""
    del question
    return True


def confirm(place: RunTarget, robot: RobotModel, method: Method, yes: bool = False) -> None:
    """Before anything moves on a real robot: look at it, say what will be done, and have it confirmed.

    Args:
        yes: whether it is confirmed already, besides by the flag of the place.

    Raises:
        SettingsError: it was not confirmed.
        MotionError: what the sensors show speaks against moving.
    """
    if not isinstance(place, HardwareTarget):
        return

    robot = for_platform(place.platform, robot)
    with open_platform(place.platform, robot, place.given) as connection:
        wrong = [finding for finding in examine(connection, robot, _LOOK_TIME) if finding.fine is False]
    for line in rehearsal_lines(rehearse(robot, method), place.platform):
        print(line, file=sys.stderr)
    for finding in wrong:
        print(f"look: {finding.name}: {finding.value}; {finding.advice}", file=sys.stderr)
    yes = yes or place.yes
    if yes and (serious := [finding for finding in wrong if finding.serious]):
        raise MotionError(
            f"{serious[0].name}: {serious[0].value}; {serious[0].advice} (see 'equipoise doctor'; without --yes you are asked)"
        )
    if yes:
        return
    print(
        "Keep clear of the robot, and a hand on its emergency stop. Ctrl-C lowers it at any time; the space bar "
        "damps it at once: it sinks.\n"
        f"Type {robot.name} to begin: ",
        end="", file=sys.stderr, flush=True,
    )  # fmt: skip
    if sys.stdin.readline().strip() != robot.name:
        raise SettingsError(f"not confirmed, nothing was moved: type {robot.name}, or give --yes in a script")


def _question_scale(method: Method, mass: float) -> None:
    """Say if a scale's mass contradicts the simulated robot's [kg]."""
    told = getattr(getattr(method, "base", method), "mass", None)  # of two methods in one run that of the base
    if told is not None and abs(told / mass - 1) > _ODD_SCALE:
        warnings.warn(f"the scale says {told:g} kg, and the simulated robot weighs {mass:.2f} kg", stacklevel=2)


def _tell_ending(report: Any) -> None:
    words = [f"guard: {report.commands} commands"]
    if report.overruns is not None:
        words.append(f"{report.overruns} more than 1 ms late")
    words.append(f"largest lean {report.largest_tilt * 57.3:.0f} deg")
    if report.hottest_motor is not None:
        words.append(f"hottest motor {report.hottest_motor:.0f} deg C")
    print(f"{', '.join(words)}; at the end: {', '.join(report.ending) or 'nothing was moved'}", file=sys.stderr)
    if report.trouble:
        print(f"guard: {report.trouble}", file=sys.stderr)
