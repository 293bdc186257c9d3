"""The motors by themselves: friction, rotor inertia, relative torque gain and delay of each joint."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from equipoise.errors import RecordingError, SettingsError
from equipoise.experiments.legs_up import legs_up
from equipoise.experiments.planted import PlantedRobot
from equipoise.experiments.progress import Progress
from equipoise.experiments.swing import swing_legs, swing_time
from equipoise.method.method import Method
from equipoise.method.rehearsal import Course, RehearsedPosture
from equipoise.motors.equations import motor_samples
from equipoise.motors.fit import MotorFit, fit_motors
from equipoise.motors.legs import legs_in_swing
from equipoise.precise.measurements.leg_swing import SwingEvidence
from equipoise.recording.recording import Recording
from equipoise.recording.trials import MotorTrial
from equipoise.result.body import Body
from equipoise.result.calibration import Calibration, Trial, model_facts
from equipoise.result.findings import Motor
from equipoise.result.quantity import Quantity
from equipoise.result.statistics import verdict_of
from equipoise.robot.inertial import nominal_inertia
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance
from equipoise.robot.statics import static_torques

_SHORTEST, _LONGEST = 3.0, 300.0  # [s]
_FOUND = (("relative_gain", "1"), ("coulomb_friction", "Nm"), ("viscous_friction", "Nm s/rad"), ("armature", "kg m2"))
_BELIEVED_GAIN, _BELIEVED_DELAY = 0.05, 5e-3  # what gains [] and delays [s] are judged beside


@dataclass(frozen=True)
class Motors(Method):
    """Friction, rotor inertia, torque gain and delay of each joint, without a stand.

    The robot lies on its belly, turns its legs up and swings all joints at once, its gains at a quarter.

    Attributes:
        motor_time: time for which the joints swing [s].
    """

    name: ClassVar[str] = "motors"
    summary: ClassVar[str] = (
        "the robot lies on its belly and swings all legs in the air; friction, rotor inertia, relative torque gain and delay "
        "of each joint, with intervals"
    )
    estimates: ClassVar[tuple[str, ...]] = ()

    motor_time: float = 10.0

    def __post_init__(self) -> None:
        if not _SHORTEST <= self.motor_time <= _LONGEST:
            raise SettingsError(f"motor_time is {self.motor_time}; it must be from {_SHORTEST:g} to {_LONGEST:g}")

    def check(self, robot: RobotModel, stance: Stance) -> None:
        legs_up(robot, stance)

    def run(
        self,
        planted: PlantedRobot,
        stance: Stance,
        recordings: Sequence[Recording],
        report: Callable[[Progress], None] | None = None,
    ) -> None:
        """Lie down, swing, stand up."""
        if report is not None:
            done = len(recordings)
            report(Progress("swing all legs in the air, lying", done, done + 1))
        swing_legs(planted, stance, self.motor_time)

    def expected_trials(self, stance: Stance) -> int:
        return 1

    def rehearse(self, robot: RobotModel, stance: Stance) -> Course:
        up = legs_up(robot, stance)
        ends = ((f"legs up, {side}", up.joint_position + sign * up.swing) for side, sign in _SIDES)
        postures = tuple(
            RehearsedPosture(what, position, static_torques(robot, position, ()), int(what == _MIDDLE))
            for what, position in ends
        )
        doing = f"lies down on its belly, turns its legs up, swings all joints for {self.motor_time:.0f} s, stands up"
        return Course(doing, swing_time(robot, stance, self.motor_time), postures)

    def estimate(self, robot: RobotModel, recordings: Sequence[Recording], stance: Stance) -> Calibration:
        """What the last complete swing says.

        Raises:
            RecordingError: there is none, or it is too short.
        """
        swings = [r for r in recordings if isinstance(r.trial, MotorTrial) and r.complete]
        if not swings:
            raise RecordingError("the recordings hold no complete swing of all joints, which tells motors apart")
        samples = motor_samples(robot, swings[-1], stance.scale.time)
        fit = fit_motors(robot, samples, stance.scale)
        nominal = nominal_inertia(robot, stance.joint_position)
        return Calibration(
            **model_facts(robot, stance.joint_position),
            method=self.name,
            composite=Body.partly(nominal.composite),
            base=Body.partly(nominal.base),
            stance_effective=Body.partly(nominal.stance_effective),
            sways={},
            support_lines={},
            trials=tuple(Trial(MotorTrial.kind, "all joints", None, None, None, None, r.duration) for r in swings),
            settings=self.to_dict(),
            warnings=_warnings(fit),
            evidence=SwingEvidence(tuple(recordings), legs_in_swing(robot, swings[-1], samples, fit, stance.scale)),
            motors=_motors(robot, fit, samples.delays),
        )


_MIDDLE = "legs up, middle"
_SIDES = (("middle", 0.0), ("forward", 1.0), ("back", -1.0))


def _motors(robot: RobotModel, fit: MotorFit, delays: tuple[np.ndarray, np.ndarray] | None) -> dict[str, Motor]:
    deviations = np.sqrt(np.diag(fit.covariance)).reshape(fit.values.shape)
    found: dict[str, Motor] = {}
    for joint, name in enumerate(robot.joint_names):
        quantities: dict[str, Quantity] = {}
        for (what, unit), values, sds in zip(_FOUND, fit.values, deviations, strict=True):
            value, deviation = float(values[joint]), float(sds[joint])
            beside = _BELIEVED_GAIN if what == "relative_gain" else abs(value)
            quantities[what] = Quantity(what, unit, value, deviation, verdict_of(deviation, beside))
        told = fit.delay if delays is None else (float(delays[0][joint]), float(delays[1][joint]))
        if told is not None:
            quantities["delay"] = Quantity("delay", "s", *told, verdict_of(told[1], _BELIEVED_DELAY))
        found[name] = Motor(**quantities, misfit=float(fit.misfit[joint]))
    return found


def _warnings(fit: MotorFit) -> tuple[str, ...]:
    if fit.delay_and_friction is None:
        return ()
    return (
        "the robot reports no torques, so that they were taken from the commands: delay and viscous friction are told apart "
        f"by the motion alone, their correlation is {fit.delay_and_friction:.2f}",
    )
