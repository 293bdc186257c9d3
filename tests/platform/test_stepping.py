"""Platforms that only step, and repeat samples: no run ends by that, and nothing is lost. And when commands are recorded."""

import math
from dataclasses import replace

import numpy as np
import pytest
from guarded import PERIOD, at_rest, simulated

from equipoise import ComSearchSettings, ExcitationSettings, PaperMethod, RunFolder, calibrate, simulate
from equipoise.guard.guard import Guard
from equipoise.platform.logged_platform import Logged
from equipoise.platform.platform import Trajectory
from equipoise.platform.stepped import PlatformWrapper
from equipoise.platform.stepping import Recorder, play_by_stepping
from equipoise.recording.recording import Recording


class Stuttering(PlatformWrapper):
    """A home-built platform: it reads and steps, and every third step brings no new sample, also where a motion ends."""

    def __init__(self, inner, change=lambda state: state):
        super().__init__(inner)
        self._last, self._count, self._change = inner.read(), 0, change

    def read(self):
        return self._last

    def step(self, command):
        state = super().step(command)
        self._count += 1
        if self._count % 3:
            self._last = self._change(state)
        return self._last

    def play(self, trajectory, stop=None):
        return play_by_stepping(self, trajectory, stop)


@pytest.fixture
def simulation(a1):
    with simulate(a1, "realistic", seed=3) as simulation:
        yield simulation


def stand(platform, count):
    return Trajectory(np.repeat(platform.read().joint_position[None], count, axis=0))


@pytest.fixture
def stuttering(simulation):
    return Stuttering(simulation.platform)


@pytest.fixture
def stay(a1, stuttering):
    """Makes a guarded robot stay where it is for so many commands. It was moved already: a soft start of 500, and one."""
    guard = Guard(stuttering, a1)
    home = guard.read().joint_position

    def stay(count):
        return guard.play(Trajectory(np.repeat(home[None], count, axis=0)))

    stay(1)
    return stay


def test_where_motions_meet_a_sample_that_comes_again_is_recorded_once(stay):
    parts = [stay(count) for count in (3, 4, 5, 3, 1, 1, 2)]
    whole = Recording.concatenate(parts)
    assert (np.diff(whole.joints.time) > 0).all()
    assert (np.diff(whole.imu.time) > 0).all()
    assert len(whole.commands.time) == 19
    assert (np.diff(whole.commands.time) > 0).all()
    assert len(whole.joints.time) >= 19 * 2 // 3  # none of those that were new is missing


def test_a_platform_that_only_repeats_itself_records_what_it_was_sent(stay, stuttering):
    stay(6)
    stuttering._count = -np.inf
    stuttering._change = lambda state: stuttering._last
    recording = stay(4)
    assert (len(recording.joints.time), len(recording.commands.time)) == (0, 4)


def test_a_command_is_recorded_when_it_was_sent_by_the_robots_clock(a1):
    """The robot's clock is half a minute behind this computer's."""
    recorder = Recorder(a1.joint_names, PERIOD)
    recorder.take(None, None, [replace(at_rest(a1, 0), received=30.0)])
    for index in range(20):
        sent = index * PERIOD + 30.0 + 7e-4
        recorder.take(np.zeros(12), sent, [replace(at_rest(a1, index + 1), received=(index + 1) * PERIOD + 30.0)])
    played = recorder.recording()
    assert played.commands.time == pytest.approx(played.joints.time + 7e-4, abs=2e-9)


def test_commands_that_seem_to_be_sent_at_once_have_increasing_times(a1):
    """By a clock that drifts past ours."""
    recorder = Recorder(a1.joint_names, PERIOD)
    for index in range(40):
        recorder.take(None, None, [replace(at_rest(a1, index), received=index * PERIOD * (1 + 2e-6))])
        recorder.take(np.zeros(12), 0.01, [])
    times = recorder.recording().commands.time
    assert len(times) == 40
    assert (np.diff(times) > 0).all()


def test_a_calibration_goes_through_as_without_lost_samples(a1, tmp_path):
    """It ended by "joint times must be finite and increasing", and with it went the recording."""
    settings = PaperMethod(com_search=ComSearchSettings(tolerance=0.02), excitation=ExcitationSettings(duration=1.0))
    folder = RunFolder.create(tmp_path / "run", a1, settings, {})
    platform, truth = simulated(a1)
    with folder, platform, Guard(Stuttering(platform), a1) as guard:
        result = calibrate(Logged(guard, folder.log), a1, settings, folder.keep)
    error = result.with_truth(truth).composite.com_in_base.errors
    assert np.abs(error[:2]).max() < 0.02
    again = RunFolder.open(folder.path).estimate()
    assert again.composite.com_in_base == result.composite.com_in_base


@pytest.mark.parametrize("time", [math.nan, math.inf, -math.inf])
def test_samples_without_a_time_are_left_out(simulation, time):
    platform = Stuttering(simulation.platform)
    platform._change = lambda state: replace(state, time=time) if platform._count == 4 else state
    recording = platform.play(stand(platform, 9))
    assert (len(recording.joints.time), len(recording.commands.time)) == (6, 9)
