"""Balance trial: shift the body over the support line, lift two feet, balance, and lower them."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import MotionError, SettingsError
from equipoise.experiments.stand import move_to, stand_up
from equipoise.lab.balance.balance_model import LinearModel, linear_model
from equipoise.lab.balance.controller import BalanceLaw
from equipoise.lab.balance.observer import SensorCorrections, StateEstimator, com_and_clearance, feet_and_com
from equipoise.lab.balance.run import BalanceRun, Ending, StateEstimates
from equipoise.lab.balance.two_foot_posture import Posture, posture_over_line
from equipoise.platform.platform import JointCommand, MotionInterrupted, Platform, RobotState
from equipoise.platform.ramp import smooth_step
from equipoise.platform.stepping import recording_of
from equipoise.recording.phases import Phase
from equipoise.recording.recording import PHASE, Event, Recording
from equipoise.robot.description import LEG_NAMES
from equipoise.robot.kinematics import foot_positions, inverse_kinematics_best_effort
from equipoise.robot.model import DIAGONALS, RobotModel
from equipoise.robot.scale import Scale
from equipoise.robot.stance import nominal_stance
from equipoise.robot.statics import static_torques

_HEIGHTS = 7  # of the lifted feet, at which the posture over the line is computed
_TOUCHING = 0.1  # of the lift height: a foot below it, according to the encoders, touches the floor or soon will
_CROUCH = 0.5  # of the hip height
_LONGEST = 3600.0  # [s]
_TOUCHED_TIME = 0.04  # [s]: shorter contacts may be errors of the estimated height
_SWING_HEIGHT = 0.19  # of the hip height: height of the lifted feet
_DELAY = 4e-3  # [s] from a sample to the effect of its command
_ARMATURE = 0.01  # [kg m2], rotor inertia at each joint of an A1, seen at the output
_TILT_LIMIT = 0.35  # [rad], tilt at which the robot counts as falling and its feet come down
_REST_TIME, _MOVE_TIME, _UNLOAD_TIME, _LIFT_TIME, _LOWER_TIME = 0.5, 1.0, 0.6, 0.08, 0.3  # [s], durations of the phases
_CATCH_TIME, _RECOVER_TIME = 0.5, 1.0  # [s] after a fall: until the robot rests on a third foot, and back to four feet
_ENGAGE_TIME = 0.02  # [s] from the lift's start until the controller acts; its model is wrong while feet touch


def balance(
    platform: Platform,
    robot: RobotModel,
    design_model: RobotModel,
    diagonal: str,
    duration: float = 10.0,
    corrections: SensorCorrections | None = None,
    watch: Callable[[], object] | None = None,
) -> BalanceRun:
    """Balance on a diagonal with joint encoders and IMU only. A fall is a result: the feet are lowered.

    Args:
        platform: robot, real or simulated.
        robot: model of the robot from its file, which determines the joint gains.
        design_model: model of the same robot that the controller is designed on.
        diagonal: diagonal to stand on, "FL_RR" or "FR_RL".
        duration: time on two feet [s].
        corrections: sensor errors to subtract; default: none.
        watch: function that is called after every control period; its result is not used.

    Raises:
        SettingsError: the diagonal is unknown, the duration is out of range, the platform's joints are not the robot's, or
            its legs have fewer than three joints.
        ReachError: a posture is out of reach.
        FallError: the robot does not stand on four feet at the beginning.
        MotionError: a measurement is not finite.
        MotionInterrupted: Ctrl-C; the feet are lowered, and the error contains the recording.
    """
    if diagonal not in DIAGONALS:
        raise SettingsError(f"diagonal is {diagonal!r}; it must be {' or '.join(DIAGONALS)}")
    check_request(robot, duration)
    standing, feet_at_end = stand_up(platform, design_model, nominal_stance(robot))
    trial = _Trial(
        platform, robot, design_model, diagonal, duration, standing.target.joint_position, standing.target.torque, watch
    )
    try:
        estimator, footholds = trial.rest(corrections or SensorCorrections.none(robot))
        postures = trial.plan(footholds)
        trial.move_over_line(estimator, postures[0])
        lift_off, ending, model = trial.lift_and_balance(estimator, footholds, postures)
    except KeyboardInterrupt:
        trial.put_feet_back()
        raise MotionInterrupted(trial.recording()) from None
    except MotionError as error:
        with suppress(MotionError):  # the first error has the reason
            trial.put_feet_back()
        error.recordings = error.recordings or (trial.recording(),)
        raise
    if ending == "balanced":
        trial.put_feet_back()
    else:
        trial.catch_fall()
        trial.put_feet_back(_RECOVER_TIME)
    move_to(standing, feet_at_end)
    return BalanceRun(
        diagonal, duration, lift_off, ending,
        trial.recording(), trial.estimates(lift_off), model.unstable_pole,
    )  # fmt: skip


def check_request(robot: RobotModel, duration: float) -> None:
    """Raise SettingsError for legs that cannot balance, or a time on two feet [s] that is out of range."""
    if robot.leg_joints.shape[1] < 3:
        raise SettingsError(
            f"{robot.name!r} cannot balance on two feet: with fewer than three joints per leg it cannot move its body across "
            "the line between them while they stay in place"
        )
    if not 0 < duration <= _LONGEST:
        raise SettingsError(f"the duration is {duration:g} s; pass for example 10s, at most one hour")


class _Trial:
    """Trial in progress. Commands are encoder positions, postures are true joint positions."""

    def __init__(
        self,
        platform: Platform,
        robot: RobotModel,
        design_model: RobotModel,
        diagonal: str,
        duration: float,
        home: FloatArray,
        home_torque: FloatArray,
        watch: Callable[[], object] | None,
    ) -> None:
        self.platform, self.robot, self.design_model = platform, robot, design_model
        self.diagonal, self.duration = diagonal, duration
        self.home, self.home_torque = home, home_torque
        self._samples: list[tuple[RobotState, FloatArray]] = []  # and the joint targets that follow from them
        self._events: list[Event] = []
        self._estimates: list[tuple[float, ...]] = []  # as in `StateEstimates`, with the platform's time
        self._watch = watch
        hip_height = self._hip_height = nominal_stance(robot).hip_height
        self.swing_height = _SWING_HEIGHT * hip_height
        self._scale = Scale.of(design_model.mass, hip_height).torque
        kp, kd = robot.gains(hip_height)
        self._gains = (kp, kd)
        self._kp, self._kd = (np.full(len(robot.joint_names), gain) for gain in (kp, kd))
        self._target, self._torque = home, home_torque
        self._state: RobotState = platform.read()

    def rest(self, corrections: SensorCorrections) -> tuple[StateEstimator, FloatArray]:
        """Stand still; return the vertical's estimator and the (4, 3) footholds, as in `feet_and_com` [m]."""
        self._begin(Phase.REST)
        states = [self._send(self.home, self.home_torque) for _ in range(self._periods(_REST_TIME))]
        estimator = StateEstimator(self.robot, corrections, states, self.platform.control_period)
        return estimator, feet_and_com(self.design_model, estimator)[0]

    def plan(self, footholds: FloatArray) -> list[Posture]:
        """Compute postures over the support line with the lifted feet at several heights."""
        heights = np.linspace(0, self.swing_height, _HEIGHTS)
        joints = self.home
        postures: list[Posture] = []
        for height in heights:
            postures.append(posture_over_line(self.design_model, footholds, self.diagonal, height, joints))
            joints = postures[-1].joint_position
        return postures

    def move_over_line(self, estimator: StateEstimator, standing: Posture) -> None:
        """Move the body over the support line on four feet, then unload the two feet that will be lifted."""
        on_four = static_torques(self.design_model, standing.joint_position, LEG_NAMES)
        self._begin(Phase.MOVE)
        self._glide(estimator.command_for(standing.joint_position), on_four, _MOVE_TIME, estimator)
        self._begin(Phase.UNLOAD)
        self._glide(self._target, standing.torque, _UNLOAD_TIME, estimator)

    def lift_and_balance(
        self, estimator: StateEstimator, footholds: FloatArray, postures: list[Posture]
    ) -> tuple[float, Ending, LinearModel]:
        """Lift two feet quickly, and balance as soon as they are off the ground.

        Returns:
            start of the lift [s], reason of its end, and linear model of the controller.
        """
        period = self.platform.control_period
        armature = _ARMATURE * self._scale
        model = linear_model(self.design_model, postures[-1], self.diagonal, self._gains, armature)
        law = BalanceLaw(model, period, round(_DELAY / period), self._scale)
        path = _lift_path(postures, self._periods(_LIFT_TIME))
        law.begin(estimator.joint_position - path[0][0], estimator.lean)
        lift_off, touched = self._state.time, 0.0
        self._begin(Phase.LIFT)
        for step in range(self._periods(_LIFT_TIME + self.duration)):
            if step == len(path):
                self._begin(Phase.BALANCE)
            time = step * period
            position, torque = path[min(step, len(path) - 1)]
            offset = law.update(
                estimator.joint_position - position,
                estimator.lean,
                estimator.angular_velocity_in_base,
                active=time >= _ENGAGE_TIME,
            )
            com_ahead, clearance = com_and_clearance(self.design_model, self.diagonal, footholds, estimator)
            tilt = float(np.arccos(np.clip(estimator.up[2], -1, 1)))
            self._estimates.append((self._state.time, tilt, com_ahead, clearance))
            down = time > _LIFT_TIME and clearance < _TOUCHING * self.swing_height
            touched = touched + period if down else 0.0
            if estimator.up[2] < np.cos(_TILT_LIMIT):
                return lift_off, "tilted", model
            if touched > _TOUCHED_TIME:
                return lift_off, "touched", model
            target = np.clip(position + offset, self.robot.lower_limit, self.robot.upper_limit)
            estimator.update(self._send(estimator.command_for(target), torque))
        return lift_off, "balanced", model

    def put_feet_back(self, duration: float = _LOWER_TIME) -> None:
        """Move the joints to the stance on four feet and hold them."""
        self._state = self.platform.read()
        self._begin(Phase.LOWER)
        self._glide(self.home, self.home_torque, duration)
        self._glide(self.home, self.home_torque, _REST_TIME)

    def catch_fall(self) -> None:
        """Retract all legs at once, so that the robot lands on its belly between the feet."""
        self._state = self.platform.read()
        self._begin(Phase.CATCH)
        feet = foot_positions(self.robot, self.home) + np.array([0.0, 0.0, _CROUCH * self._hip_height])
        self._target = inverse_kinematics_best_effort(self.robot, feet, self.home)
        self._torque = np.zeros_like(self._torque)
        self._glide(self._target, self._torque, _CATCH_TIME)

    def estimates(self, lift_off: float) -> StateEstimates:
        """Return all estimates; times count from `lift_off` [s]."""
        time, *estimates = np.array(self._estimates).T
        return StateEstimates(time - lift_off, *estimates)

    def recording(self) -> Recording:
        """Return all samples and commands, without samples that are not finite."""
        finite = [(state, target) for state, target in self._samples if _is_finite(state)]
        states, targets = [state for state, _ in finite], np.array([target for _, target in finite])
        return recording_of(self.platform.joint_names, states, targets, tuple(self._events))

    def _begin(self, phase: str) -> None:
        self._events.append(Event(self._state.time, PHASE, {"name": phase}))

    def _glide(
        self, target: FloatArray, torque: FloatArray, duration: float, estimator: StateEstimator | None = None
    ) -> None:
        """Move the commands smoothly to other targets and torques."""
        start, start_torque = self._target, self._torque
        for share in smooth_step(self._periods(duration)):
            state = self._send(start + share * (target - start), start_torque + share * (torque - start_torque))
            if estimator is not None:
                estimator.update(state)

    def _send(self, target: FloatArray, torque: FloatArray) -> RobotState:
        if not np.isfinite(target).all():
            raise MotionError(
                f"at {self._state.time:.3f} s a measurement is not finite; the feet were lowered. Check encoders and IMU"
            )
        if not self._samples or self._state.time > self._samples[-1][0].time:
            self._samples.append((self._state, target))
        self._target, self._torque = target, torque
        self._state = self.platform.step(JointCommand(target, torque=torque, kp=self._kp, kd=self._kd))
        if self._watch is not None:
            self._watch()
        return self._state

    def _periods(self, duration: float) -> int:
        return max(1, round(duration / self.platform.control_period))


def _is_finite(state: RobotState) -> bool:
    arrays = (
        state.joint_position, state.joint_velocity, state.joint_torque,
        state.angular_velocity_in_imu, state.acceleration_in_imu,
    )  # fmt: skip
    return all(array is None or bool(np.isfinite(array).all()) for array in arrays)


def _lift_path(postures: list[Posture], count: int) -> list[tuple[FloatArray, FloatArray]]:
    """Return joint positions and torques of a lift, one pair per period: fast at first, to lift the feet at once."""
    share = np.arange(count + 1) / count
    heights = share * (2 - share) * (len(postures) - 1)
    path = np.array([np.concatenate([posture.joint_position, posture.torque]) for posture in postures])
    joints = path.shape[1] // 2
    columns: list[FloatArray] = [np.interp(heights, np.arange(len(postures)), column) for column in path.T]
    between = np.column_stack(columns)
    return [(row[:joints], row[joints:]) for row in between]
