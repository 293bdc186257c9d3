"""Stand on a diagonal and stay there: shift the body over the line, lift two feet, balance, and put them back."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import MotionError, SettingsError
from equipoise.experiments.stand import move_to, stand_up
from equipoise.lab.balance.balance_model import LinearModel, linear_model
from equipoise.lab.balance.controller import BalanceLaw, BalanceWeights
from equipoise.lab.balance.observer import Bearings, Senses, SensorKnowledge
from equipoise.lab.balance.run import BalanceRun, Ending, TrialSamples
from equipoise.lab.balance.two_foot_posture import Posture, posture_over_line
from equipoise.platform.platform import JointCommand, MotionInterrupted, Platform, RobotState
from equipoise.platform.ramp import smooth_step
from equipoise.recording.phases import Phase
from equipoise.robot.description import LEG_NAMES
from equipoise.robot.kinematics import foot_positions, inverse_kinematics_best_effort
from equipoise.robot.model import DIAGONALS, RobotModel
from equipoise.robot.scale import Scale
from equipoise.robot.stance import nominal_stance
from equipoise.robot.statics import static_torques

_HEIGHTS = 7  # of the lifted feet, at which the posture over the line is computed
_TOUCHING = 0.1  # of its lift's height: a foot that the encoders say is lower than that touches the floor, or soon will
_CROUCH = 0.5  # of the hip height
_TOUCHED_TIME = 0.04  # [s]; an estimate of a foot's height that is wrong for a moment ends nothing


@dataclass(frozen=True)
class BalanceSettings:
    """How a robot is put on two feet and kept there.

    Attributes:
        duration: time for which it is to balance [s].
        observe_offset: observe how far the true centre of mass is from the believed one, and stand accordingly. The robot
            then balances although its model is wrong: a measurement, no proof of the model.
        swing_height: height of the lifted feet, over the hip height.
        delay: time from a sample's moment until a command that follows from it acts [s].
        armature: rotor inertia seen at each joint, on an A1 [kg m2].
        tilt_limit: tilt at which the robot counts as falling and its feet come down [rad].
        rest_time, move_time, unload_time, lift_time, lower_time: durations of the phases [s].
        catch_time, recover_time: times of a fall: until it rests on a third foot, and for the way back to four [s].
        engage_time: time from the lift's start until the law acts [s]; while feet still touch it would act on another
            robot.
        observe_time: time from the lift's start until the offset is observed [s].
        weights: weights of the law.
    """

    duration: float = 10.0
    observe_offset: bool = False
    swing_height: float = 0.19
    delay: float = 4e-3
    armature: float = 0.01
    tilt_limit: float = 0.35
    rest_time: float = 0.5
    move_time: float = 1.0
    unload_time: float = 0.6
    lift_time: float = 0.08
    lower_time: float = 0.3
    catch_time: float = 0.5
    recover_time: float = 1.0
    engage_time: float = 0.02
    observe_time: float = 0.15
    weights: BalanceWeights = field(default_factory=BalanceWeights)

    def __post_init__(self) -> None:
        if not (np.isfinite(self.duration) and self.duration > 0):
            raise SettingsError(f"the duration is {self.duration:g} s; it must be a positive time, as 10s")
        if not (np.isfinite(self.delay) and 0 <= self.delay <= 0.05):
            raise SettingsError(f"the delay is {self.delay:g} s; it must be between 0 and 0.05 s")


def balance(
    platform: Platform,
    robot: RobotModel,
    believed: RobotModel,
    diagonal: str,
    settings: BalanceSettings | None = None,
    knowledge: SensorKnowledge | None = None,
    watch: Callable[[], object] | None = None,
) -> BalanceRun:
    """Balance on a diagonal by joint encoders and IMU alone. A robot that falls is data: its feet are put down.

    Args:
        platform: robot, real or simulated.
        robot: model of the robot by its file; the joint gains follow from it.
        believed: model of the same robot with the inertia that the law is designed on.
        diagonal: diagonal to stand on, "FL_RR" or "FR_RL".
        knowledge: sensor errors that are known; default: none.
        watch: function that is called after every control period; what it returns is not used.

    Raises:
        SettingsError: the diagonal is unknown, or the platform's joints are not the robot's.
        ReachError: a posture is out of reach.
        FallError: the robot does not stand on four feet to begin with.
        MotionError: a sensor says what is no number.
        MotionInterrupted: Ctrl-C; the feet have been put down, and what was recorded is in it.
    """
    if diagonal not in DIAGONALS:
        raise SettingsError(f"{diagonal!r} is no diagonal; they are {', '.join(DIAGONALS)}")
    settings = settings or BalanceSettings()
    standing, feet_at_end = stand_up(platform, believed, nominal_stance(robot))
    trial = _Trial(
        platform, robot, believed, diagonal, settings, standing.target.joint_position, standing.target.torque, watch
    )
    try:
        senses, bearings = trial.rest(knowledge or SensorKnowledge.none(robot))
        postures = trial.plan(bearings)
        trial.move_over_line(senses, postures[0])
        lift_off, ending, model = trial.lift_and_balance(senses, bearings, postures)
    except KeyboardInterrupt:
        trial.put_feet_back()
        raise MotionInterrupted(trial.samples.recording(platform.joint_names)) from None
    except MotionError as error:
        with suppress(MotionError):  # of a platform that no longer moves; the first error says why
            trial.put_feet_back()
        error.recordings = error.recordings or (trial.samples.recording(platform.joint_names),)
        raise
    if ending == "balanced":
        trial.put_feet_back()
    else:
        trial.catch_fall()
        trial.put_feet_back(settings.recover_time)
    move_to(standing, feet_at_end)
    return BalanceRun(
        robot.name, diagonal, settings.duration, trial.swing_height, settings.observe_offset, lift_off, ending,
        trial.samples.recording(platform.joint_names), trial.samples.felt(lift_off), model.unstable_pole,
    )  # fmt: skip


class _Trial:
    """One trial under way. What is sent is in the encoders' own coordinates; postures are of the true joints."""

    def __init__(
        self,
        platform: Platform,
        robot: RobotModel,
        believed: RobotModel,
        diagonal: str,
        settings: BalanceSettings,
        home: FloatArray,
        home_torque: FloatArray,
        watch: Callable[[], object] | None,
    ) -> None:
        self.platform, self.robot, self.believed = platform, robot, believed
        self.diagonal, self.settings = diagonal, settings
        self.home, self.home_torque = home, home_torque
        self.samples = TrialSamples()
        self._watch = watch
        hip_height = self._hip_height = nominal_stance(robot).hip_height
        self.swing_height = settings.swing_height * hip_height
        self._scale = Scale.of(believed.mass, hip_height).torque
        kp, kd = robot.gains(hip_height)
        self._gains = (kp, kd)
        self._kp, self._kd = (np.full(len(robot.joint_names), gain) for gain in (kp, kd))
        self._target, self._torque = home, home_torque
        self._state: RobotState = platform.read()

    def rest(self, knowledge: SensorKnowledge) -> tuple[Senses, Bearings]:
        """Stand still, and learn where up is and where the feet are."""
        self._begin(Phase.REST)
        states = [self._send(self.home, self.home_torque) for _ in range(self._periods(self.settings.rest_time))]
        senses = Senses(self.robot, knowledge, states, self.platform.control_period)
        return senses, Bearings(self.believed, self.diagonal, senses)

    def plan(self, bearings: Bearings) -> list[Posture]:
        """The postures over the support line, the lifted feet at several heights."""
        heights = np.linspace(0, self.swing_height, _HEIGHTS)
        joints = self.home
        postures: list[Posture] = []
        for height in heights:
            postures.append(posture_over_line(self.believed, bearings.footholds, self.diagonal, height, joints))
            joints = postures[-1].joint_position
        return postures

    def move_over_line(self, senses: Senses, standing: Posture) -> None:
        """Bring the body over the support line on four feet, then take the load off the two that will be lifted."""
        on_four = static_torques(self.believed, standing.joint_position, LEG_NAMES)
        self._begin(Phase.MOVE)
        self._glide(senses.command_for(standing.joint_position), on_four, self.settings.move_time, senses)
        self._begin(Phase.UNLOAD)
        self._glide(self._target, standing.torque, self.settings.unload_time, senses)

    def lift_and_balance(
        self, senses: Senses, bearings: Bearings, postures: list[Posture]
    ) -> tuple[float, Ending, LinearModel]:
        """Lift two feet quickly, and let the law act as soon as they are off the ground.

        Returns:
            time at which the lift began [s], reason why it ended, and model that the law was designed on.
        """
        settings, period = self.settings, self.platform.control_period
        armature = settings.armature * self._scale
        model = linear_model(self.believed, postures[-1], self.diagonal, self._gains, armature)
        delay = round(settings.delay / period)
        law = BalanceLaw(model, period, delay, settings.weights, self._scale, settings.observe_offset)
        path = _lift_path(postures, self._periods(settings.lift_time))
        law.begin(senses.joint_position - path[0][0], senses.lean)
        lift_off, touched = self._state.time, 0.0
        self._begin(Phase.LIFT)
        for step in range(self._periods(settings.lift_time + settings.duration)):
            if step == len(path):
                self._begin(Phase.BALANCE)
            time = step * period
            position, torque = path[min(step, len(path) - 1)]
            offset = law.update(
                senses.joint_position - position,
                senses.lean,
                senses.angular_velocity_in_base,
                active=time >= settings.engage_time,
                observe=time >= settings.observe_time,
            )
            com_ahead, clearance = bearings.of(senses)
            self.samples.feel(self._state.time, senses.up, com_ahead, clearance, law.offset)
            down = time > settings.lift_time and clearance < _TOUCHING * self.swing_height
            touched = touched + period if down else 0.0
            if senses.up[2] < np.cos(settings.tilt_limit):
                return lift_off, "tilted", model
            if touched > _TOUCHED_TIME:
                return lift_off, "touched", model
            wanted = np.clip(position + offset, self.robot.lower_limit, self.robot.upper_limit)
            senses.feel(self._send(senses.command_for(wanted), torque))
        return lift_off, "balanced", model

    def put_feet_back(self, duration: float | None = None) -> None:
        """To four feet from wherever the robot is: the joints go to the stance and stay there."""
        self._state = self.platform.read()
        self._begin(Phase.LOWER)
        self._glide(self.home, self.home_torque, duration or self.settings.lower_time)
        self._glide(self.home, self.home_torque, self.settings.rest_time)

    def catch_fall(self) -> None:
        """Drop the body between the feet: all legs are drawn up at once, and the belly is what it lands on."""
        self._state = self.platform.read()
        self._begin(Phase.CATCH)
        feet = foot_positions(self.robot, self.home) + np.array([0.0, 0.0, _CROUCH * self._hip_height])
        self._target = inverse_kinematics_best_effort(self.robot, feet, self.home)
        self._torque = np.zeros_like(self._torque)
        self._glide(self._target, self._torque, self.settings.catch_time)

    def _begin(self, phase: str) -> None:
        self.samples.phase(phase, self._state.time)

    def _glide(self, target: FloatArray, torque: FloatArray, duration: float, senses: Senses | None = None) -> None:
        """Bring what is sent smoothly to other targets and torques."""
        start, start_torque = self._target, self._torque
        for share in smooth_step(self._periods(duration)):
            state = self._send(start + share * (target - start), start_torque + share * (torque - start_torque))
            if senses is not None:
                senses.feel(state)

    def _send(self, target: FloatArray, torque: FloatArray) -> RobotState:
        if not np.isfinite(target).all():
            raise MotionError(
                f"at {self._state.time:.3f} s a sensor said what is no number; the feet were put down. Check the encoders "
                "and the IMU",
            )
        self.samples.add(self._state, target)
        self._target, self._torque = target, torque
        self._state = self.platform.step(JointCommand(target, torque=torque, kp=self._kp, kd=self._kd))
        if self._watch is not None:
            self._watch()
        return self._state

    def _periods(self, duration: float) -> int:
        return max(1, round(duration / self.platform.control_period))


def _lift_path(postures: list[Posture], count: int) -> list[tuple[FloatArray, FloatArray]]:
    """Joint positions and torques of a lift, one pair a period: quick at first, so that the feet are off at once."""
    share = np.arange(count + 1) / count
    heights = share * (2 - share) * (len(postures) - 1)
    path = np.array([np.concatenate([posture.joint_position, posture.torque]) for posture in postures])
    joints = path.shape[1] // 2
    columns: list[FloatArray] = [np.interp(heights, np.arange(len(postures)), column) for column in path.T]
    between = np.column_stack(columns)
    return [(row[:joints], row[joints:]) for row in between]
