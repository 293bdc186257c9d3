"""Base class of calibration methods."""

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
    """Calibration method; its settings are the fields of a frozen dataclass.

    A field can be a dataclass of settings. Each field is a command-line flag; its help is from the docstring's
    "Attributes". Metadata of a field change its flags:

    - `{"prefix": "excitation_"}` prefixes the flags of the nested settings; None omits these flags.
    - `{"file": read}` makes one flag: a file that `read` parses. `"metavar"` names the file in the help.
    - `{"flag": False}` omits the flag.

    Attributes:
        name: name on the command line, such as `--method bayesian`.
        summary: description in one sentence.
        estimates: names of the estimated parameters of the whole robot: "mass", "com_x", "com_y", "com_z",
            "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz".
        estimate_only: names of the settings that affect only `estimate`, and may differ when recordings are estimated again.
        timestep: largest simulation time step that does not affect the method's results [s].
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    estimates: ClassVar[tuple[str, ...]]
    estimate_only: ClassVar[tuple[str, ...]] = ()
    timestep: ClassVar[float] = 0.5e-3

    def check(self, robot: RobotModel, stance: Stance) -> None:
        """Check the settings against a robot, before any motion.

        Raises:
            SettingsError: a setting does not suit the robot.
            ReachError: a posture is out of reach or not safe.
        """
        return None

    def compare_mass(self, standing: StandingRobot, stance: Stance) -> MassComparison | None:
        """Compare a given mass with the joint torques of the standing robot, before `run`.

        Returns:
            the comparison that the operator has to confirm, or None.
        """
        return None

    @abstractmethod
    def run(
        self,
        standing: StandingRobot,
        stance: Stance,
        recordings: Sequence[Recording],
        report: Callable[[Progress], None] | None = None,
    ) -> None:
        """Do the trials, from the stance; `standing.keep` stores the recordings.

        Args:
            standing: robot on four feet at its stance.
            stance: nominal stance of the robot.
            recordings: stored recordings so far; decisions depend on them alone.
            report: function that is called before every trial.

        Raises:
            MotionError: a motion failed.
        """

    @abstractmethod
    def estimate(self, robot: RobotModel, recordings: Sequence[Recording], stance: Stance) -> Calibration:
        """Estimate from the recordings of a run of this method.

        Raises:
            RecordingError: the recordings are not sufficient.
        """

    @abstractmethod
    def rehearse(self, robot: RobotModel, stance: Stance) -> Course:
        """Return the motions of `run`, from the model alone.

        Raises:
            SettingsError: a setting does not suit the robot.
            ReachError: a posture is out of reach.
        """

    def forecast(self, robot: RobotModel, stance: Stance, swings: Sequence[Recording] = ()) -> Forecast | None:
        """Predict the accuracy of `estimate` after the trials of `run`; None if the method cannot.

        Args:
            swings: predicted recordings of swinging legs in the same run, for a method that uses them.
        """
        return None

    def predicted_recordings(self, robot: RobotModel, stance: Stance) -> tuple[Recording, ...]:
        """Predict the recordings of `run` from the model, for another method of the same run.

        Raises:
            ReachError: a posture is out of reach.
        """
        return ()

    def expected_trials(self, stance: Stance) -> int | None:
        """Return the approximate number of trials of `run`, or None."""
        return None

    def reading(self, robot: RobotModel, stance: Stance, recordings: Sequence[Recording]) -> Reading | None:
        """Return the estimates of the CoM after each trial, for display; None if the method has none.

        Raises:
            RecordingError: the recordings cannot be read.
        """
        return None

    def weighed(self: Self, mass: float, std: float) -> Self:
        """Return the method with the mass from a scale, or itself if it does not use a mass.

        Args:
            mass: mass of the whole robot [kg].
            std: standard deviation of that mass [kg].
        """
        return self

    @property
    def uses_swings(self) -> bool:
        """True if `estimate` uses the recordings of swinging legs in the same run."""
        return False

    def having(self: Self, settings: Mapping[str, Any]) -> Self:
        """Return a copy with other values of some settings, by field name; raises SettingsError."""
        return dataclasses.replace(self, **settings)

    def study_columns(self, result: Calibration, stance: Stance) -> Mapping[str, Any]:
        """Return the columns of a study's table that are specific to this method, for a result with evidence."""
        return {}

    def attachments(self) -> Mapping[str, Mapping[str, Any]]:
        """Return large settings as JSON values by name; a run stores each in its own file."""
        return {}

    def to_dict(self) -> dict[str, Any]:
        """Return name and settings as JSON values."""
        return {"method": self.name, **fields_to_json(self)}

    @classmethod
    def from_dict(cls: type[Self], table: Mapping[str, Any]) -> Self:
        """Return a method from the settings in `to_dict`; missing ones have their default.

        Raises:
            SettingsError: a setting is unknown or invalid.
        """
        return from_json(cls, {name: value for name, value in table.items() if name != "method"})
