"""Standing robot under command: its last targets and its current recordings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from equipoise.clearance.clearance import Clearance
from equipoise.conventions import FloatArray
from equipoise.errors import MotionError, ReachError
from equipoise.experiments.motion import Motion, Target
from equipoise.platform.platform import MotionInterrupted, Platform, TiltLimit
from equipoise.recording.event import TRIAL
from equipoise.recording.recording import Recording
from equipoise.robot.kinematics import foot_positions
from equipoise.robot.model import RobotModel

_STANCE_ACCELERATION = 0.6  # [m/s2]; shifts an A1's load by 2 cm of the 18 between its CoM and its front feet
_PEAK_OF_SMOOTH_STEP = 5.77  # peak acceleration of a minimum-jerk move of unit length and duration


class StandingRobot:
    """Robot on four feet under command, with its platform, last target and nominal feet.

    Recordings since the last `take` are stored, so that an interruption does not lose them.

    Attributes:
        keep: function called with every recording as soon as its motion is complete, before it is evaluated.
        operator_done: function that returns True once the operator has confirmed a request; None without an operator.
    """

    def __init__(self, platform: Platform, robot: RobotModel, target: Target, home: FloatArray) -> None:
        self.platform, self.robot, self.target, self.home = platform, robot, target, home
        self.keep: Callable[[Recording], None] = lambda recording: None
        self.operator_done: Callable[[], bool] | None = None
        self._recorded: list[Recording] = []
        self._trials = 0  # number of trials so far, and id of the last one
        self._trial: int | None = None  # id of the present trial, until its recording is complete
        self._clearance = Clearance(robot, target.joint_position)

    def start_from(self, target: Target) -> None:
        """Set the target of a robot that was moved by hand."""
        self.target = target
        self._clearance.begin(target.joint_position)

    def motion(self) -> Motion:
        """Return a new motion from the last target."""
        return Motion(self.robot, self.platform.control_period, self.target)

    @staticmethod
    def move_time(
        feet_in_base: FloatArray, start: FloatArray, least: float, acceleration: float = _STANCE_ACCELERATION
    ) -> float:
        """Return the duration of a stance motion that does not tip the robot over [s]."""
        distance = float(np.linalg.norm(feet_in_base - start, axis=1).max())
        return max(least, float(np.sqrt(_PEAK_OF_SMOOTH_STEP * distance / acceleration)))

    def play(self, motion: Motion, stop: TiltLimit | None = None) -> Recording:
        """Play a motion; the next one starts where this one ended or was stopped.

        Raises:
            ReachError: links would touch; the robot does not move.
        """
        trajectory = motion.build()
        if (contact := self._clearance.first_contact(trajectory.position)) is not None:
            raise ReachError(f"{contact}; the robot was not moved")
        if self._trial is None and any(event.name == TRIAL for event in trajectory.events):
            self._trials += 1
            self._trial = self._trials
        try:
            recording = self.platform.play(replace(trajectory, trial=self._trial), stop)
        except MotionInterrupted as interruption:
            if interruption.recording is not None:
                self._recorded.append(interruption.recording)
            raise
        except MotionError as error:  # the guard stopped the robot
            self._recorded += error.recordings
            raise
        self._recorded.append(recording)
        self.target = motion.target
        played = len(trajectory.position) if recording.commands is None else len(recording.commands.time)
        if played < len(trajectory.position) and trajectory.torque is not None:
            position = trajectory.position[played - 1]
            feet = foot_positions(self.robot, position)
            self.target = Target(position, feet, trajectory.torque[played - 1], motion.target.legs)
        return recording

    def finish(self) -> Recording:
        """Pass the recordings since the last call to `keep` as one, and return it."""
        recording = self._whole()
        self.keep(recording)
        self._recorded, self._trial = [], None
        return recording

    def take(self) -> Recording | None:
        """Return the recordings since the last call as one; None without any."""
        whole = self._whole() if self._recorded else None
        self._recorded, self._trial = [], None
        return whole

    def _whole(self) -> Recording:
        return replace(Recording.concatenate(self._recorded), trial_id=self._trial)
