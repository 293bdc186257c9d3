"""Motors method: friction, rotor inertia, relative torque gain and delay of each joint."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from typing import ClassVar

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import ReachError, SettingsError
from equipoise.estimator.motors.delay import motor_trial
from equipoise.estimator.motors.fit import MotorFit, complete_swings, fit_swings, last_swings
from equipoise.experiments.legs_up import legs_up
from equipoise.experiments.one_leg_up import legs_in_turn
from equipoise.experiments.progress import Progress
from equipoise.experiments.stand import move_to
from equipoise.experiments.standing_robot import StandingRobot
from equipoise.experiments.swing import swing_leg, swing_legs, swing_time, swing_time_on_three
from equipoise.method.method import Method
from equipoise.method.rehearsal import Course, RehearsedPosture
from equipoise.motors.nominal import nominal_swing
from equipoise.motors.settings import MotorsSettings
from equipoise.recording.recording import Recording
from equipoise.recording.trials import MotorTrial
from equipoise.result.body import Body
from equipoise.result.calibration import Calibration, Evidence, Trial, model_facts
from equipoise.result.findings import Motor
from equipoise.result.quantity import Quantity
from equipoise.result.statistics import verdict_of
from equipoise.robot.inertial import nominal_inertia
from equipoise.robot.model import LEG_NAMES, RobotModel
from equipoise.robot.stance import Stance
from equipoise.robot.statics import static_torques

_SHORTEST_OF_LEG = 1.2  # [s] on an A1: fifty averages and the excluded ends
_FOUND = (
    ("relative_gain", "1"), ("coulomb_friction", "Nm"), ("viscous_friction", "Nm s/rad"), ("armature", "kg m2"),
    ("stribeck_friction", "Nm"),  # if the data require it
)  # fmt: skip
_REFERENCE_GAIN, _REFERENCE_DELAY = 0.05, 5e-3  # gain [1] and delay [s] that verdicts compare the std with


@dataclass(frozen=True)
class Motors(MotorsSettings, Method):
    """Method that estimates friction, rotor inertia, torque gain and delay of each joint, without a stand.

    The robot lies on its belly, turns its legs up and swings all joints at once with a quarter of their gains. Otherwise it
    stands on three feet and swings the fourth leg, each leg in turn. See `MotorsSettings` for its settings.
    """

    name: ClassVar[str] = "motors"
    estimates: ClassVar[tuple[str, ...]] = ()

    def check(self, robot: RobotModel, stance: Stance) -> None:
        if self.lies(robot, stance):
            return
        legs_in_turn(robot, stance)
        least = len(LEG_NAMES) * _SHORTEST_OF_LEG * stance.scale.time
        if self.motor_time < least:
            raise SettingsError(
                f"motor_time is {self.motor_time:g}; {robot.name!r} swings its legs one after the other, which takes "
                f"{least:.1f} s or more"
            )

    def lies(self, robot: RobotModel, stance: Stance) -> bool:
        """Return True if the robot lies on its belly while it swings, False if it stands on three feet.

        Raises:
            ReachError: it cannot do either, or not the requested one.
        """
        if self.motor_stance == "three-feet":
            return False
        if (reason := _why_not_lying(robot, stance)) is None:
            return True
        if self.motor_stance == "belly":
            raise ReachError(f"{reason}, or set motor_stance to three-feet")
        try:
            legs_in_turn(robot, stance)
        except ReachError as standing:
            raise ReachError(f"{reason}; {standing}") from standing
        return False

    def run(
        self,
        standing: StandingRobot,
        stance: Stance,
        recordings: Sequence[Recording],
        report: Callable[[Progress], None] | None = None,
    ) -> None:
        """Lie down, swing, stand up; or stand on three feet and swing, four times."""
        done = len(recordings)

        def announce(what: str, number: int, of: int) -> None:
            if report is not None:
                report(Progress(what, done + number, done + of))

        if self.lies(standing.robot, stance):
            announce("swing all legs in the air, lying", 0, 1)
            swing_legs(standing, stance, self.motor_time)
            return
        for number, up in enumerate(legs_in_turn(standing.robot, stance)):
            announce(f"swing the {up.leg} leg, on three feet", number, len(LEG_NAMES))
            swing_leg(standing, stance, up, self.motor_time / len(LEG_NAMES))
        move_to(standing, stance.feet_in_base)

    def expected_trials(self, stance: Stance) -> int | None:
        return {"belly": 1, "three-feet": len(LEG_NAMES)}.get(self.motor_stance)

    def rehearse(self, robot: RobotModel, stance: Stance) -> Course:
        if self.lies(robot, stance):
            up = legs_up(robot, stance)
            doing = (
                f"lies down on its belly, turns its legs up, swings all joints for {self.motor_time:.0f} s, stands up"
            )
            postures = _swung("legs up", robot, up.joint_position, up.swing, ())
            return Course(doing, swing_time(robot, stance, self.motor_time), postures, lies=True)
        each, ups = self.motor_time / len(LEG_NAMES), legs_in_turn(robot, stance)
        doing = (
            f"moves its body over three feet, lifts the fourth and swings that leg for {each:.1f} s, each leg in turn"
        )
        on_three = (_swung(f"{up.leg} leg up", robot, up.joint_position, up.swing, up.standing) for up in ups)
        return Course(doing, swing_time_on_three(robot, stance, self.motor_time), tuple(chain(*on_three)))

    def predicted_recordings(self, robot: RobotModel, stance: Stance) -> tuple[Recording, ...]:
        """Predict the recording of a swing lying; none on three feet, where the base's motion is not predicted."""
        return (nominal_swing(robot, stance, self.motor_time),) if self.lies(robot, stance) else ()

    def estimate(self, robot: RobotModel, recordings: Sequence[Recording], stance: Stance) -> Calibration:
        """Estimate the motors from the last complete swing of each leg.

        Raises:
            RecordingError: it is missing or too short.
        """
        fit = fit_swings(robot, stance, tuple(last_swings(recordings)))
        nominal = nominal_inertia(robot, stance.joint_position)
        return Calibration(
            **model_facts(robot, stance.joint_position),
            method=self.name,
            composite=Body.partial(nominal.composite),
            base=Body.partial(nominal.base),
            stance_effective=Body.partial(nominal.stance_effective),
            excitations={},
            support_lines={},
            trials=tuple(_trial_of(recording) for recording in complete_swings(recordings)),
            settings=self.to_dict(),
            warnings=_warnings(fit),
            evidence=Evidence(tuple(recordings)),
            motors=_motors(robot, fit),
        )


@lru_cache(maxsize=16)  # the search takes seconds
def _why_not_lying(robot: RobotModel, stance: Stance) -> str | None:
    """Return the reason why the robot cannot swing its legs lying, or None."""
    try:
        legs_up(robot, stance)
    except ReachError as error:
        return str(error)
    return None


def _trial_of(recording: Recording) -> Trial:
    leg = motor_trial(recording).leg
    what = "all joints" if leg is None else f"{leg} leg"
    return Trial(MotorTrial.kind, what, None, None, None, None, recording.duration)


_MIDDLE = "middle"
_SIDES = ((_MIDDLE, 0.0), ("forward", 1.0), ("back", -1.0))


def _swung(
    what: str, robot: RobotModel, middle: FloatArray, swing: FloatArray, standing: tuple[str, ...]
) -> tuple[RehearsedPosture, ...]:
    """Return the middle and both ends of a swing."""
    postures = [(f"{what}, {side}", middle + sign * swing, int(side == _MIDDLE)) for side, sign in _SIDES]
    return tuple(
        RehearsedPosture(name, position, static_torques(robot, position, standing), times)
        for name, position, times in postures
    )


def _motors(robot: RobotModel, fit: MotorFit) -> dict[str, Motor]:
    stds = np.sqrt(np.diag(fit.covariance)).reshape(fit.values.shape)
    delays, found = fit.problem.samples.delays, dict[str, Motor]()
    for joint, name in enumerate(robot.joint_names):
        quantities: dict[str, Quantity] = {}
        for (what, unit), values, sds in zip(_FOUND[: len(fit.values)], fit.values, stds, strict=True):
            value, std = float(values[joint]), float(sds[joint])
            reference = _REFERENCE_GAIN if what == "relative_gain" else abs(value)
            quantities[what] = Quantity(what, unit, value, std, verdict_of(std, reference))
        delay = fit.delay if delays is None else (float(delays[0][joint]), float(delays[1][joint]))
        if delay is not None:
            quantities["delay"] = Quantity("delay", "s", *delay, verdict_of(delay[1], _REFERENCE_DELAY))
        found[name] = Motor(**quantities, residual=float(fit.residual[joint]))
    return found


def _warnings(fit: MotorFit) -> tuple[str, ...]:
    if fit.delay_and_friction is None:
        return ()
    return (
        "the robot does not report torques, so they were computed from the commands: only the motion separates delay from "
        f"viscous friction; their correlation is {fit.delay_and_friction:.2f}",
    )
