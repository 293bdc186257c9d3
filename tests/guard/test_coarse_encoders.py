"""Encoders of 10 to 13 bits read the same for long and are not frozen; one that is frozen among them is found."""

from dataclasses import replace

import numpy as np
import pytest
from guarded import simulated

from equipoise import BayesianMethod, Guard, calibrate
from equipoise.calibration.routine import perform
from equipoise.errors import MotionError, RecordingError
from equipoise.estimator.diagnostics.screening import screen_log
from equipoise.guard.sample_filter import SampleFilter
from equipoise.platform.platform import RobotState
from equipoise.platform.stepped import PlatformWrapper
from equipoise.platform.stepping import play_by_stepping
from equipoise.recording.recording import Recording

STEPS = [0.8e-3, 1.0e-3, 1.5e-3, 3.0e-3, 6.1e-3]  # [rad]: 13 to 10 bits
CALF = 2


def coarse(position, step):
    return step * np.round(position / step)


class Coarse(PlatformWrapper):
    """A simulated robot whose encoders have steps."""

    def _sensed(self, state):
        return replace(state, joint_position=coarse(state.joint_position, 1.5e-3))

    def read(self):
        return self._sensed(super().read())

    def step(self, command):
        return self._sensed(super().step(command))

    def play(self, trajectory, stop=None):
        return play_by_stepping(self, trajectory, stop)


class Kept(PlatformWrapper):
    """A platform that keeps its recordings."""

    def __init__(self, inner):
        super().__init__(inner)
        self.recordings = []

    def play(self, trajectory, stop=None):
        self.recordings.append(super().play(trajectory, stop))
        return self.recordings[-1]


@pytest.fixture(scope="module")
def recording(a1):
    """A whole calibration with fine encoders."""
    platform, *_ = simulated(a1)
    kept = Kept(platform)
    perform(kept, a1, BayesianMethod(duration=40.0))
    return Recording.concatenate(kept.recordings)


def with_steps(recording, step, frozen=None):
    position = coarse(recording.joints.position, step)
    if frozen is not None:
        position[len(position) // 3 :, frozen] = position[len(position) // 3, frozen]
    return replace(recording, joints=replace(recording.joints, position=position))


def filtered(robot, recording):
    """Put samples through the guard's filter one by one, each with the target that was sent before it."""
    sieve = SampleFilter(robot, 0.002, 0.1)
    joints, imu, commands = recording.joints, recording.imu, recording.commands
    targets = commands.position[np.searchsorted(commands.time, joints.time, side="right") - 1]
    nearest = np.searchsorted(imu.time, joints.time).clip(max=len(imu.time) - 1)
    for index, time in enumerate(joints.time):
        at = nearest[index]
        state = RobotState(
            time, joints.position[index], None, None, imu.angular_velocity_in_imu[at], imu.acceleration_in_imu[at]
        )
        sieve.accept([state], targets[index])


@pytest.mark.parametrize("step", STEPS)
def test_coarse_encoders_are_not_frozen(a1, recording, step):
    filtered(a1, with_steps(recording, step))
    screen_log(a1, with_steps(recording, step))


@pytest.mark.parametrize("step", STEPS)
def test_a_frozen_encoder_among_coarse_ones_is_named(a1, recording, step):
    frozen = with_steps(recording, step, frozen=CALF)
    with pytest.raises(MotionError, match="'FL_calf_joint' is frozen"):
        filtered(a1, frozen)
    with pytest.raises(RecordingError, match="'FL_calf_joint' is frozen"):
        screen_log(a1, frozen)


def test_a_robot_with_coarse_encoders_is_calibrated_behind_the_guard(a1):
    platform, *_ = simulated(a1, seed=1)
    with Guard(Coarse(platform), a1) as guard:
        result = calibrate(guard, a1, BayesianMethod(duration=30.0, mass=12.46))
    assert all(check.passed for check in result.checks), result.checks
