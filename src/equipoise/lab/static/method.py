"""Static baseline method: planar CoM and mass from the joint torques of the standing robot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from equipoise.method.method import Method

if TYPE_CHECKING:
    from equipoise.experiments.progress import Progress
    from equipoise.experiments.standing_robot import StandingRobot
    from equipoise.method.rehearsal import Course
    from equipoise.recording.recording import Recording
    from equipoise.result.calibration import Calibration
    from equipoise.robot.model import RobotModel
    from equipoise.robot.stance import Stance

_DURATION = 3.0  # [s] with the motion to the stance


@dataclass(frozen=True)
class Static(Method):
    """Planar CoM and mass from the foot forces of the standing robot."""

    name: ClassVar[str] = "static"
    summary: ClassVar[str] = "mass and planar centre of mass from the joint torques of the standing robot"
    estimates: ClassVar[tuple[str, ...]] = ("mass", "com_x", "com_y")
    timestep: ClassVar[float] = 1e-3

    def run(
        self,
        standing: StandingRobot,
        stance: Stance,
        recordings: Sequence[Recording],
        report: Callable[[Progress], None] | None = None,
    ) -> None:
        from equipoise.lab.static.standing import stand_still  # noqa: PLC0415 - flags need no robot model

        stand_still(standing, stance, report)

    def rehearse(self, robot: RobotModel, stance: Stance) -> Course:
        from equipoise.method.rehearsal import Course  # noqa: PLC0415

        return Course("stands still for a while", _DURATION)

    def expected_trials(self, stance: Stance) -> int:
        return 1

    def estimate(self, robot: RobotModel, recordings: Sequence[Recording], stance: Stance) -> Calibration:
        from equipoise.lab.static.standing import estimate_standing  # noqa: PLC0415

        return estimate_standing(robot, recordings, stance, self.to_dict())
