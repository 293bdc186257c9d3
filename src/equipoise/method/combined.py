"""Combination of a method for the base and the method for the motors in one run."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from numpy.linalg import LinAlgError

from equipoise.errors import RecordingError
from equipoise.experiments.progress import Progress
from equipoise.experiments.standing_robot import StandingRobot
from equipoise.method.method import Method
from equipoise.method.reading import Reading
from equipoise.method.rehearsal import Course, Forecast
from equipoise.recording.recording import Recording
from equipoise.recording.trials import MotorTrial
from equipoise.result.calibration import Calibration
from equipoise.result.mass_comparison import MassComparison
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance

AND_MOTORS = "and_motors"
"""Key of the motors' settings in those of a combined method."""


def base_recordings(recordings: Sequence[Recording]) -> list[Recording]:
    """Return the recordings that depend on the base: all but those of swinging legs."""
    return [recording for recording in recordings if not isinstance(recording.trial, MotorTrial)]


@dataclass(frozen=True)
class CombinedMethod(Method):
    """Method for the base, followed by the method for the motors.

    The base's result equals that of the base method alone, unless legs are estimated, which use the swings too.

    Attributes:
        base: method for the base.
        motors: method for the motors.
    """

    base: Method
    motors: Method

    def __post_init__(self) -> None:
        for name in ("name", "summary", "estimates", "estimate_only", "timestep"):  # class attributes of other methods
            object.__setattr__(self, name, getattr(self.base, name))

    def check(self, robot: RobotModel, stance: Stance) -> None:
        self.base.check(robot, stance)
        self.motors.check(robot, stance)

    def compare_mass(self, standing: StandingRobot, stance: Stance) -> MassComparison | None:
        return self.base.compare_mass(standing, stance)

    def run(
        self,
        standing: StandingRobot,
        stance: Stance,
        recordings: Sequence[Recording],
        report: Callable[[Progress], None] | None = None,
    ) -> None:
        self.base.run(standing, stance, recordings, report)
        self.motors.run(standing, stance, recordings, report)

    def estimate(self, robot: RobotModel, recordings: Sequence[Recording], stance: Stance) -> Calibration:
        try:
            motors = self.motors.estimate(robot, recordings, stance)
        except (RecordingError, LinAlgError) as error:  # the base can still be estimated
            found = self.base.estimate(robot, base_recordings(recordings), stance)
            return dataclasses.replace(found, warnings=(*found.warnings, f"motors: {error}"), settings=self.to_dict())
        found = self.base.estimate(robot, self._for_the_base(recordings), stance)
        return dataclasses.replace(
            found,
            motors=motors.motors,
            trials=(*found.trials, *motors.trials),
            warnings=(*found.warnings, *motors.warnings),
            settings=self.to_dict(),
        )

    def _for_the_base(self, recordings: Sequence[Recording]) -> Sequence[Recording]:
        """Return the recordings that the base method uses."""
        return recordings if self.base.uses_swings else base_recordings(recordings)

    def rehearse(self, robot: RobotModel, stance: Stance) -> Course:
        first, second = self.base.rehearse(robot, stance), self.motors.rehearse(robot, stance)
        return Course(
            f"{first.doing}, {second.doing}",
            first.duration + second.duration,
            (*first.postures, *second.postures),
            first.lies or second.lies,
            first.replans or second.replans,
        )

    def forecast(self, robot: RobotModel, stance: Stance, swings: Sequence[Recording] = ()) -> Forecast | None:
        """Return the base method's forecast, with predicted swings if it uses them."""
        predicted = self.motors.predicted_recordings(robot, stance) if self.base.uses_swings else ()
        return self.base.forecast(robot, stance, (*swings, *predicted))

    def expected_trials(self, stance: Stance) -> int | None:
        return self.base.expected_trials(stance)

    def reading(self, robot: RobotModel, stance: Stance, recordings: Sequence[Recording]) -> Reading | None:
        return self.base.reading(robot, stance, self._for_the_base(recordings))

    def weighed(self, mass: float, std: float) -> CombinedMethod:
        return dataclasses.replace(self, base=self.base.weighed(mass, std))

    def having(self, settings: Mapping[str, Any]) -> CombinedMethod:
        return dataclasses.replace(self, base=self.base.having(settings))

    def study_columns(self, result: Calibration, stance: Stance) -> Mapping[str, Any]:
        return self.base.study_columns(result, stance)

    def attachments(self) -> Mapping[str, Mapping[str, Any]]:
        return self.base.attachments()

    def to_dict(self) -> dict[str, Any]:
        return {**self.base.to_dict(), AND_MOTORS: self.motors.to_dict()}
