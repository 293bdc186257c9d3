"""Bayesian method: mass, 3-D CoM and inertia, with the sensors calibrated in the same estimate."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from equipoise.bayesian.estimate import estimate_run
from equipoise.bayesian.plan import Durations, Plan
from equipoise.bayesian.rehearse import rehearse
from equipoise.bayesian.routine import BayesianRoutine, plan_ahead
from equipoise.bayesian.settings import BayesianSettings
from equipoise.bayesian.short_plan import forecast_after
from equipoise.bayesian.short_routine import ShortRoutine
from equipoise.errors import ReachError
from equipoise.estimator.diagnostics.torque_mass import compare_at_rest
from equipoise.estimator.measurements.scale_reading import check_mass_of
from equipoise.estimator.reading import BayesianReading
from equipoise.experiments.dip import dip
from equipoise.experiments.progress import Progress
from equipoise.experiments.standing_robot import StandingRobot
from equipoise.method.method import Method
from equipoise.method.rehearsal import Course
from equipoise.recording.recording import Recording
from equipoise.result.calibration import Calibration
from equipoise.result.mass_comparison import MassComparison
from equipoise.robot.inertial import COMPONENTS
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance, lies, lying_posture


@dataclass(frozen=True)
class BayesianMethod(BayesianSettings, Method):
    """Estimation of mass, 3-D CoM and inertia, with the sensors calibrated in the same estimate.

    The robot lifts two diagonal feet in many postures, at rest and rotating its body, and measures how it tips.
    """

    name: ClassVar[str] = "bayesian"
    estimates: ClassVar[tuple[str, ...]] = COMPONENTS

    def weighed(self, mass: float, std: float) -> BayesianMethod:
        return replace(self, mass=mass, mass_std=std, confirm_mass=True)  # there is no operator to ask

    @property
    def uses_swings(self) -> bool:
        return self.swings

    def to_dict(self) -> dict[str, Any]:
        own = {name: value for name, value in super().to_dict().items() if name != "prior_run"}
        return own if self.prior_run is None else {**own, "prior_run": self.prior_run.reference}

    def attachments(self) -> Mapping[str, Mapping[str, Any]]:
        return {} if self.prior_run is None else {"prior_run": self.prior_run.to_dict()}

    def check(self, robot: RobotModel, stance: Stance) -> None:
        """Check that duration and mass suit the robot (SettingsError), and that it can lift and lie down (ReachError)."""
        if self.rotate_halfway and not lies(robot, stance, lying_posture(robot, stance)[0]):
            raise ReachError(f"{robot.name!r} cannot lie down over its feet to be turned; omit --rotate-halfway")
        if self.mass is not None:
            check_mass_of(robot, self.mass)
        self.forecast(robot, stance)

    def forecast(self, robot: RobotModel, stance: Stance, swings: Sequence[Recording] = ()) -> Plan:
        if self.prior_run is not None:
            return forecast_after(robot, stance, self, self.prior_run)
        return plan_ahead(robot, stance, self, swings)

    def expected_trials(self, stance: Stance) -> int:
        return round(self.duration_for(stance) / Durations.of(stance).lift)

    def compare_mass(self, standing: StandingRobot, stance: Stance) -> MassComparison | None:
        if self.scale is None or self.confirm_mass or standing.platform.read().joint_torque is None:
            return None
        compared = compare_at_rest(standing.robot, stance, self.scale, dip(standing, stance), self.prior_run)
        return compared if compared is not None and compared.disagrees else None

    def run(
        self,
        standing: StandingRobot,
        stance: Stance,
        recordings: Sequence[Recording],
        report: Callable[[Progress], None] | None = None,
    ) -> None:
        """Run the search, the planned trials and the excitation."""
        kind = BayesianRoutine if self.prior_run is None else ShortRoutine
        kind(standing, stance, self, recordings, report).run()

    def rehearse(self, robot: RobotModel, stance: Stance) -> Course:
        return rehearse(robot, stance, self, self.forecast(robot, stance))

    def reading(self, robot: RobotModel, stance: Stance, recordings: Sequence[Recording]) -> BayesianReading:
        return BayesianReading(robot, stance, recordings, self.combined_priors, self.scale, self.prior_run)

    def estimate(
        self, robot: RobotModel, recordings: Sequence[Recording], stance: Stance, lifts_needed: bool = True
    ) -> Calibration:
        """Estimate the inertial parameters from a run's recordings, as `estimate_run`."""
        return estimate_run(self, self.to_dict(), robot, recordings, stance, lifts_needed)
