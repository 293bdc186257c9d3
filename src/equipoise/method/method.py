"""A method of calibration: its settings, and what it does with them."""

from __future__ import annotations

import dataclasses
import types
import typing
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, TypeVar, cast

from equipoise.errors import SettingsError
from equipoise.experiments.planted import PlantedRobot
from equipoise.experiments.progress import Progress
from equipoise.method.reading import Reading
from equipoise.method.rehearsal import Course, Forecast
from equipoise.recording.recording import Recording
from equipoise.result.calibration import Calibration
from equipoise.result.mass_comparison import MassComparison
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

Self = TypeVar("Self", bound="Method")
Settings = TypeVar("Settings")


@dataclasses.dataclass(frozen=True)
class Method(ABC):
    """A method with its settings: the fields of a frozen dataclass.

    A field may be a dataclass of settings itself. On the command line fields are flags, with what the docstring's
    "Attributes" say as help; `metadata={"prefix": "sway_"}` of a field that holds settings begins the names of their flags,
    and None as a prefix leaves them without flags. `metadata={"file": read}` makes one flag of such a field, a file that
    `read` reads; `"metavar"` beside it is what help calls that file. `metadata={"flag": False}` makes none.

    Attributes:
        name: name that users choose it by, as in `--method precise`.
        summary: sentence that says what it does.
        estimates: names of the parameters of the whole robot that it estimates: "mass", "com_x", "com_y", "com_z",
            "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz".
        judging: names of the settings that matter to `estimate` alone, and with which recordings may be estimated again.
        timestep: largest time step of a simulation that leaves the method's results as they are [s].
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    estimates: ClassVar[tuple[str, ...]]
    judging: ClassVar[tuple[str, ...]] = ()
    timestep: ClassVar[float] = 0.5e-3

    def check(self, robot: RobotModel, stance: Stance) -> None:
        """Refuse settings that do not fit a robot, before anything moves.

        Raises:
            SettingsError: a setting does not fit the robot's size.
            ReachError: a posture is out of reach or not safe.
        """
        return None

    def mass_in_doubt(self, planted: PlantedRobot, stance: Stance) -> MassComparison | None:
        """Compare a given mass with the joint torques of the standing robot, before `run`.

        Returns:
            the comparison that the operator has to confirm; None: there is nothing to confirm.
        """
        del planted, stance
        return None

    @abstractmethod
    def run(
        self,
        planted: PlantedRobot,
        stance: Stance,
        recordings: Sequence[Recording],
        report: Callable[[Progress], None] | None = None,
    ) -> None:
        """Do the trials, from the stance; recordings go where `planted.keep` takes them.

        Args:
            planted: robot, on four feet at its stance.
            stance: nominal stance of the robot.
            recordings: recordings that were kept so far: decisions depend on them alone.
            report: function that is called before every trial.

        Raises:
            MotionError: the robot could not do, or did not do, what was asked.
        """

    @abstractmethod
    def estimate(self, robot: RobotModel, recordings: Sequence[Recording], stance: Stance) -> Calibration:
        """What the recordings of a run of this method say.

        Raises:
            RecordingError: they do not hold what the method needs.
        """

    @abstractmethod
    def rehearse(self, robot: RobotModel, stance: Stance) -> Course:
        """What `run` would do, by the model.

        Raises:
            SettingsError: a setting does not fit the robot.
            ReachError: something is out of reach.
        """

    def forecast(self, robot: RobotModel, stance: Stance, swings: Sequence[Recording] = ()) -> Forecast | None:
        """How accurate `estimate` would be after the trials of `run`; None from a method that does not predict it.

        Args:
            swings: predicted recordings of legs that swing in the same run, for a method that uses them.
        """
        return None

    def predicted_recordings(self, robot: RobotModel, stance: Stance) -> tuple[Recording, ...]:
        """What `run` would record for another method of the same run, of a robot that is as its model says.

        Raises:
            ReachError: something is out of reach.
        """
        del robot, stance
        return ()

    def expected_trials(self, stance: Stance) -> int | None:
        """How many trials `run` does, roughly; None if nobody knows."""
        return None

    def reading(self, robot: RobotModel, stance: Stance, recordings: Sequence[Recording]) -> Reading | None:
        """What is known of the CoM after each trial, to be looked at; None from a method that does not tell.

        Raises:
            RecordingError: the recordings cannot be read.
        """
        return None

    def weighed(self: Self, mass: float, deviation: float) -> Self:
        """The same method, told what a scale says; itself if it does not use that.

        Args:
            mass: mass of the whole robot [kg].
            deviation: standard deviation of that mass [kg].
        """
        del mass, deviation
        return self

    @property
    def uses_swings(self) -> bool:
        """Whether `estimate` uses the recordings of legs that swing in the same run."""
        return False

    def having(self: Self, settings: Mapping[str, Any]) -> Self:
        """The same method with other values of some settings, by field name; raises SettingsError."""
        return dataclasses.replace(self, **settings)

    def study_columns(self, result: Calibration, stance: Stance) -> Mapping[str, Any]:
        """Columns of a study's table that only this method fills, of a result with its evidence."""
        del result, stance
        return {}

    def attachments(self) -> Mapping[str, Mapping[str, Any]]:
        """Settings that are too large to stand among the others, whole, as JSON values by name; a run has a file of each."""
        return {}

    def to_dict(self) -> dict[str, Any]:
        """Name and settings as JSON values."""
        return {"method": self.name, **dataclasses.asdict(self)}

    @classmethod
    def from_dict(cls: type[Self], table: Mapping[str, Any]) -> Self:
        """From the settings in `to_dict`; those that are missing are the default ones.

        Raises:
            SettingsError: a setting is not known, or is none that can be.
        """
        return read_settings(cls, {name: value for name, value in table.items() if name != "method"})


def read_settings(kind: type[Settings], table: Mapping[str, Any], above: str = "") -> Settings:
    """A dataclass of settings, and those in it, from JSON values by field name; raises SettingsError."""
    hints = typing.get_type_hints(kind)
    known = [field.name for field in dataclasses.fields(cast("Any", kind))]
    given: dict[str, Any] = {}
    for name, value in table.items():
        if name not in known:
            raise SettingsError(f"unknown setting {above + name!r}; known are {', '.join(known)}")
        given[name] = _converted(hints[name], value, above + name)
    return kind(**given)


def _converted(hint: Any, value: Any, name: str) -> Any:
    """A JSON value as a setting's type: tables are dataclasses of settings, lists are tuples, whole numbers numbers."""
    of_union = typing.get_origin(hint) in (typing.Union, types.UnionType)
    kinds = [kind for kind in (typing.get_args(hint) if of_union else (hint,)) if kind is not type(None)]
    found = cast("type[Any]", type(value))
    if found is type(None) and len(kinds) < len(typing.get_args(hint)):
        return None
    if dataclasses.is_dataclass(kinds[0]):
        if not issubclass(found, Mapping):
            raise SettingsError(f"setting {name!r} is {value!r}; it must be a table")
        return read_settings(cast("type[Any]", kinds[0]), value, f"{name}.")
    if found is list and tuple in (*kinds, *map(typing.get_origin, kinds)):
        return tuple(value)
    plain = [kind for kind in kinds if kind in (bool, int, float, str)]
    if len(plain) < len(kinds) or found in plain:
        return value  # other types are for the settings to refuse
    if found is int and float in plain:
        return float(value)
    raise SettingsError(f"setting {name!r} is {value!r}; it must be {' or '.join(kind.__name__ for kind in plain)}")
