"""A method of calibration: its settings, and what it does with them."""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from equipoise.json_form import fields_to_json, from_json

if TYPE_CHECKING:  # flags are read without a robot model
    from equipoise.experiments.progress import Progress
    from equipoise.experiments.standing_robot import StandingRobot
    from equipoise.method.reading import Reading
    from equipoise.method.rehearsal import Course, Forecast
    from equipoise.recording.recording import Recording
    from equipoise.result.calibration import Calibration
    from equipoise.result.mass_comparison import MassComparison
    from equipoise.robot.model import RobotModel
    from equipoise.robot.stance import Stance

Self = TypeVar("Self", bound="Method")


@dataclasses.dataclass(frozen=True)
class Method(ABC):
    """A method with its settings: the fields of a frozen dataclass.

    A field can be a dataclass of settings. Each field is a command-line flag; its help is the docstring's "Attributes".
    Metadata of a field change its flags:

    - `{"prefix": "excitation_"}` prefixes the flags of the nested settings; None omits these flags.
    - `{"file": read}` makes one flag: a file that `read` parses. `"metavar"` names the file in the help.
    - `{"flag": False}` omits the flag.

    Attributes:
        name: name that users choose it by, as in `--method bayesian`.
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

    def mass_in_doubt(self, standing: StandingRobot, stance: Stance) -> MassComparison | None:
        """Compare a given mass with the joint torques of the standing robot, before `run`.

        Returns:
            the comparison that the operator has to confirm; None: there is nothing to confirm.
        """
        del standing, stance
        return None

    @abstractmethod
    def run(
        self,
        standing: StandingRobot,
        stance: Stance,
        recordings: Sequence[Recording],
        report: Callable[[Progress], None] | None = None,
    ) -> None:
        """Do the trials, from the stance; recordings go where `planted.keep` takes them.

        Args:
            standing: robot, on four feet at its stance.
            stance: nominal stance of the robot.
            recordings: recordings that were kept so far: decisions depend on them alone.
            report: function that is called before every trial.

        Raises:
            MotionError: the robot could not do, or did not do, what was asked.
        """

    @abstractmethod
    def estimate(self, robot: RobotModel, recordings: Sequence[Recording], stance: Stance) -> Calibration:
        """Estimate from the recordings of a run of this method.

        Raises:
            RecordingError: they do not hold what the method needs.
        """

    @abstractmethod
    def rehearse(self, robot: RobotModel, stance: Stance) -> Course:
        """Return the motions of `run`, from the model alone.

        Raises:
            SettingsError: a setting does not fit the robot.
            ReachError: something is out of reach.
        """

    def forecast(self, robot: RobotModel, stance: Stance, swings: Sequence[Recording] = ()) -> Forecast | None:
        """Predict the accuracy of `estimate` after the trials of `run`; None from a method that cannot.

        Args:
            swings: predicted recordings of legs that swing in the same run, for a method that uses them.
        """
        return None

    def predicted_recordings(self, robot: RobotModel, stance: Stance) -> tuple[Recording, ...]:
        """Predict the recordings that `run` makes for another method of the same run, from the model.

        Raises:
            ReachError: something is out of reach.
        """
        del robot, stance
        return ()

    def expected_trials(self, stance: Stance) -> int | None:
        """Return the approximate number of trials of `run`; None if it is not known."""
        return None

    def reading(self, robot: RobotModel, stance: Stance, recordings: Sequence[Recording]) -> Reading | None:
        """Return the estimates of the CoM after each trial, for display; None from a method without them.

        Raises:
            RecordingError: the recordings cannot be read.
        """
        return None

    def weighed(self: Self, mass: float, std: float) -> Self:
        """Return the method with the mass from a scale; itself if it does not use that.

        Args:
            mass: mass of the whole robot [kg].
            std: standard deviation of that mass [kg].
        """
        del mass, std
        return self

    @property
    def uses_swings(self) -> bool:
        """True if `estimate` uses the recordings of legs that swing in the same run."""
        return False

    def having(self: Self, settings: Mapping[str, Any]) -> Self:
        """Return the method with other values of some settings, by field name; raises SettingsError."""
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
        return {"method": self.name, **fields_to_json(self)}

    @classmethod
    def from_dict(cls: type[Self], table: Mapping[str, Any]) -> Self:
        """From the settings in `to_dict`; those that are missing are the default ones.

        Raises:
            SettingsError: a setting is not known, or is none that can be.
        """
        return from_json(cls, {name: value for name, value in table.items() if name != "method"})
