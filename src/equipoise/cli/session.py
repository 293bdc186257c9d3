"""Where a calibration runs: a simulated robot, or a real one behind the guard. Says so in a run's provenance, to resume it."""

from __future__ import annotations

import dataclasses
import sys
import warnings
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from equipoise.cli.operator_prompt import Keyboard
from equipoise.errors import MotionError, RecordingError, SettingsError

if TYPE_CHECKING:
    from equipoise.calibration.run_folder import RunFolder
    from equipoise.guard.report import GuardReport
    from equipoise.method.method import Method
    from equipoise.platform.platform import Platform
    from equipoise.recording.run_log_reader import LogContent
    from equipoise.result.calibration import Calibration
    from equipoise.robot.model import RobotModel
    from equipoise.simulation.simulation import Simulation

_ODD_SCALE = 0.03  # of the robot's mass
_LOOK_TIME = 1.0  # [s] at a robot before anybody is asked to confirm


@dataclass(frozen=True)
class Place:
    """What the flags say about where a run happens.

    Attributes:
        platform: name of a simulator or a robot's platform, or MODULE:CLASS.
        given: settings of the driver.
        noise, payload, seed, start, noise_seed: preset, payload, seeds and beginning of a simulated robot.
        effects, without, contacts: what of the preset is otherwise.
    """

    platform: str
    given: Mapping[str, Any] = field(default_factory=dict[str, Any])
    noise: str = "realistic"
    payload: str | None = None
    seed: int = 0
    start: str = "standing"
    noise_seed: int | None = None
    effects: Mapping[str, float | None] = field(default_factory=dict[str, "float | None"])
    without: tuple[str, ...] = ()
    contacts: str = "own"

    def __post_init__(self) -> None:
        from equipoise.drivers.platforms import find_platform

        find_platform(self.platform)  # before anything is made for it

    @property
    def simulated(self) -> bool:
        from equipoise.platform.engines import ENGINES

        return self.platform in ENGINES

    @property
    def world(self) -> str:
        """The simulated robot's effects in words."""
        others = [name if size is None else f"{name} {size:g}" for name, size in self.effects.items()]
        words = [f"noise {self.noise}", *(f"with {other}" for other in others), *(f"without {n}" for n in self.without)]
        return ", ".join(words + ["contacts of the file"] * (self.contacts == "file"))

    def facts(self) -> dict[str, Any]:
        """For a run's provenance: enough to resume it."""
        if not self.simulated:
            return {"platform": self.platform, "platform_settings": dict(self.given)}
        names = ("platform", "noise", "payload", "seed", "start", "noise_seed")
        facts = {name: getattr(self, name) for name in names}
        other = {"effects": dict(self.effects), "without": list(self.without), "contacts": self.contacts}
        usual: dict[str, Any] = {"effects": {}, "without": [], "contacts": "own"}
        return facts | {name: value for name, value in other.items() if value != usual[name]}

    def again(self, number: int) -> Place:
        """Where the same robot is calibrated once more: if it is simulated, with the same errors and other noise."""
        if not self.simulated or number == 0:
            return self
        return dataclasses.replace(
            self, noise_seed=(self.seed if self.noise_seed is None else self.noise_seed) + number
        )

    @classmethod
    def of(cls, folder: RunFolder) -> Place:
        """Where a run was made.

        Raises:
            RecordingError: it does not say, or not well enough to go on there.
        """
        facts = folder.provenance
        if "platform_settings" in facts:
            return cls(str(facts["platform"]), dict(facts["platform_settings"]))
        names = ("platform", "noise", "payload", "seed", "start")
        if missing := [name for name in names if name not in facts]:
            raise RecordingError(
                f"the run {str(folder.path)!r} does not say its {missing[0]}; runs of 'equipoise calibrate' can be resumed"
            )
        return cls(
            **{name: facts[name] for name in names}, noise_seed=facts.get("noise_seed"), effects=facts.get("effects", {}),
            without=tuple(facts.get("without", ())), contacts=facts.get("contacts", "own"),
        )  # fmt: skip


class Session:
    """A place that is open: runs calibrations, one after the other.

    Args:
        place: platform that the flags name, with its settings.
        robot: model of the robot.
    """

    def __init__(self, place: Place, robot: RobotModel) -> None:
        from equipoise.drivers.platforms import for_platform

        self.place, self.robot = place, for_platform(place.platform, robot)
        self._simulation: Simulation | None = None
        self._report: GuardReport | None = None  # of a real robot, once it was put down
        if place.simulated:
            from equipoise.simulation.simulation import simulate

            self._simulation = simulate(
                robot, place.noise, place.payload, place.seed, place.start, engine=place.platform,  # pyright: ignore
                noise_seed=place.noise_seed, effects=place.effects, without=place.without,
                contacts=place.contacts,  # pyright: ignore
            )  # fmt: skip

    @property
    def facts(self) -> dict[str, Any]:
        """For a run's provenance."""
        engine = {} if self._simulation is None else {self.place.platform: self._simulation.engine}
        return {**self.place.facts(), **engine}

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *exception: object) -> None:
        if self._simulation is not None:
            self._simulation.platform.close()

    def run(self, folder: RunFolder, method: Method, quiet: bool, content: LogContent | None = None) -> Calibration:
        """One calibration into a run folder.

        Args:
            content: content of the folder's log, if the run is gone on with.
        """
        from equipoise.calibration.routine import perform, with_guard_report
        from equipoise.terminal.calibration import TrialProgress

        with folder:
            if self._simulation is not None:
                folder.save_truth(self._simulation.truth, self._simulation.truth_of_parts)
                _question_scale(method, self._simulation.truth.composite.mass)
            with TrialProgress(quiet) as progress:
                with self._platform(folder, content) as (platform, keyboard):
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
        if self._simulation is None:
            return result if self._report is None else with_guard_report(result, self._report)
        return result.with_truth(self._simulation.truth).with_truth_of_parts(self._simulation.truth_of_parts)

    @contextmanager
    def _platform(self, folder: RunFolder, content: LogContent | None) -> Generator[tuple[Platform, Keyboard]]:
        """The platform that the routine moves, and the operator's keyboard."""
        from equipoise.platform.logged_platform import Logged
        from equipoise.platform.resumed import RepeatedSimulation, ResumedRobot

        if self._simulation is not None:
            bare = self._simulation.platform
            logged = Logged(bare, folder.log)
            yield (logged if content is None else RepeatedSimulation(logged, bare, content)), Keyboard()
            return
        from equipoise.guard.remote_robot import RemoteRobot

        remote = RemoteRobot(self.place.platform, self.robot, self.place.given, folder.log, folder.path / "ending.txt")
        for line in (f"robot process: {remote.realtime}", remote.warning):
            if line:
                print(line, file=sys.stderr)
        try:
            with remote, Keyboard(remote.stop) as keyboard:
                yield (remote if content is None else ResumedRobot(remote, content)), keyboard
        finally:
            self._report = remote.report()
            _tell_ending(self._report)


def _went_on(sentence: str) -> bool:
    """Whether a run goes on whose lifts have begun: yes."""
    del sentence
    return True


def confirm(place: Place, robot: RobotModel, method: Method, yes: bool) -> None:
    """Before anything moves on a real robot: look at it, say what will be done, and have it confirmed.

    Raises:
        SettingsError: it was not confirmed.
        MotionError: what the sensors show speaks against moving.
    """
    if place.simulated:
        return
    from equipoise.calibration.rehearsal import rehearse
    from equipoise.drivers.checkup import examine
    from equipoise.drivers.platforms import for_platform, open_platform
    from equipoise.terminal.platform import rehearsal_lines

    robot = for_platform(place.platform, robot)
    with open_platform(place.platform, robot, place.given) as connection:
        wrong = [finding for finding in examine(connection, robot, _LOOK_TIME) if finding.fine is False]
    for line in rehearsal_lines(rehearse(robot, method), place.platform):
        print(line, file=sys.stderr)
    for finding in wrong:
        print(f"look: {finding.name}: {finding.value}; {finding.advice}", file=sys.stderr)
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
