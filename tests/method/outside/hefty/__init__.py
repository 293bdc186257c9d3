"""Method of another package: the mass is from the joint torques of a standing robot, the rest from the model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import numpy as np

from equipoise import Calibration, InertialParameters, Method, Recording, RobotModel, Stance
from equipoise.errors import RecordingError, SettingsError
from equipoise.experiments.lift import LiftSettings, come_to_rest
from equipoise.experiments.progress import Progress
from equipoise.experiments.standing_robot import StandingRobot
from equipoise.method.reading import ComEstimate, LiftPlane
from equipoise.method.rehearsal import Course
from equipoise.recording.phases import Phase
from equipoise.recording.trials import StandTrial
from equipoise.result.body import Body
from equipoise.result.calibration import Trial, model_facts
from equipoise.robot.inertial import nominal_inertia
from equipoise.robot.statics import carried_mass


@dataclass(frozen=True)
class Pauses:
    """Settings of the stands.

    Attributes:
        time: time of each stand [s]; default 1.5 s.
        count: number of stands.
    """

    time: float | None = None
    count: int = 2


@dataclass(frozen=True)
class Hefty(Method):
    """Estimation of the mass from stands.

    Attributes:
        average: combination of the stands.
        pauses: settings of the stands.
    """

    name: ClassVar[str] = "hefty"
    summary: ClassVar[str] = "stands still now and then, and weighs itself"
    estimates: ClassVar[tuple[str, ...]] = (
        "mass", "com_x", "com_y", "com_z", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz",
    )  # fmt: skip
    estimate_only: ClassVar[tuple[str, ...]] = ("average",)
    timestep: ClassVar[float] = 1e-3

    average: Literal["mean", "last"] = "mean"
    pauses: Pauses = field(default_factory=Pauses, metadata={"prefix": "pause_"})

    def check(self, robot: RobotModel, stance: Stance) -> None:
        if self.pauses.count < 1:
            raise SettingsError(f"pause_count is {self.pauses.count}; it must be 1 or more")

    def run(
        self, standing: StandingRobot, stance: Stance, recordings: Sequence[Recording],
        report: Callable[[Progress], None] | None = None,
    ) -> None:  # fmt: skip
        for number in range(self.pauses.count):
            if report is not None:
                report(Progress("weighing itself", number, self.pauses.count))
            stand(standing, stance, self.pauses.time or 1.5)

    def rehearse(self, robot: RobotModel, stance: Stance) -> Course:
        return Course(f"stands still {self.pauses.count} times", 2.0 * self.pauses.count)

    def expected_trials(self, stance: Stance) -> int:
        return self.pauses.count

    def reading(self, robot: RobotModel, stance: Stance, recordings: Sequence[Recording]) -> ModelReading:
        return ModelReading(nominal_inertia(robot, stance.joint_position).composite.com)

    def study_columns(self, result: Calibration, stance: Stance) -> Mapping[str, Any]:
        return {"iteration_x": [0.0]}

    def estimate(self, robot: RobotModel, recordings: Sequence[Recording], stance: Stance) -> Calibration:
        stands = [r for r in recordings if isinstance(r.trial, StandTrial) and r.complete]
        if not stands:
            raise RecordingError("the recordings contain no complete stand")
        rests = [recording.phase(Phase.REST).joints for recording in stands]
        masses = [carried_mass(robot, rest.position.mean(axis=0), rest.torque.mean(axis=0)) for rest in rests]
        mass = masses[-1] if self.average == "last" else float(np.mean(masses))
        nominal = nominal_inertia(robot, stance.joint_position)
        added = mass - nominal.composite.mass
        return Calibration(
            **model_facts(robot, stance.joint_position),
            method=self.name,
            composite=Body.complete(_heavier(nominal.composite, added), model=nominal.composite),
            base=Body.complete(_heavier(nominal.base, added), model=nominal.base),
            stance_effective=Body.partial(nominal.stance_effective),
            excitations={},
            support_lines={},
            trials=tuple(Trial(StandTrial.kind, "four feet", None, None, None, None, r.duration) for r in stands),
            settings=self.to_dict(),
        )


@dataclass(frozen=True)
class ModelReading:
    """CoM of the model, as the estimate after each trial."""

    com: np.ndarray

    def planes(self) -> list[LiftPlane]:
        return []

    def estimate(self, trials: int) -> ComEstimate:
        return ComEstimate(trials, self.com, np.full(3, 0.01), 1e-5 * np.eye(3))


def stand(standing: StandingRobot, stance: Stance, time: float) -> None:
    """Record a stand as a trial."""
    motion = standing.motion().begin(StandTrial()).phase(Phase.MOVE).move_feet(stance.feet_in_base, 0.2)
    come_to_rest(standing, motion, LiftSettings(height=0.0, rest_time=time), "standing")
    standing.finish()


def _heavier(body: InertialParameters, added: float) -> InertialParameters:
    factor = 1 + added / body.mass
    return InertialParameters(body.mass + added, body.com, factor * body.inertia)
