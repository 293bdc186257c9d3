"""Platforms that only step, and say the same thing twice: no run ends by that, and nothing is lost."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from guarded import simulated

from equipoise import ComSearchSettings, Paper, RunFolder, SwaySettings, calibrate, simulate
from equipoise.errors import RecordingError, UnrecordedError
from equipoise.platform.logged import Logged
from equipoise.platform.platform import Trajectory
from equipoise.platform.stepping import play_by_stepping
from equipoise.platform.wrapper import PlatformWrapper
from equipoise.recording.recording import Recording

pytestmark = pytest.mark.usefixtures("coarse_engine")


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


def test_where_motions_meet_a_sample_that_comes_again_is_recorded_once(simulation):
    platform = Stuttering(simulation.platform)
    parts = [platform.play(stand(platform, count)) for count in (3, 4, 5, 3, 1, 1, 2)]
    whole = Recording.concatenate(parts)
    assert (np.diff(whole.joints.time) > 0).all()
    assert (np.diff(whole.imu.time) > 0).all()
    assert len(whole.commands.time) == 19
    assert (np.diff(whole.commands.time) > 0).all()
    assert len(whole.joints.time) >= 19 * 2 // 3  # none of those that were new is missing


def test_a_platform_that_only_repeats_itself_records_what_it_was_sent(simulation):
    platform = Stuttering(simulation.platform)
    platform.play(stand(platform, 6))
    platform._count = -np.inf
    platform._change = lambda state: platform._last
    recording = platform.play(stand(platform, 4))
    assert (len(recording.joints.time), len(recording.commands.time)) == (0, 4)


def test_a_command_is_recorded_when_the_platform_says_that_it_left(simulation):
    """By the robot's clock, which is half a minute behind ours here."""
    platform = simulation.platform
    step = platform.step
    platform.step = lambda command: late(step(command))

    def late(state):
        return replace(state, received=state.time + 30.0, commanded=state.time + 30.0 - 7e-4)

    played = play_by_stepping(platform, stand(platform, 20))
    assert played.commands.time[1:-1] == pytest.approx(played.joints.time[2:] - 7e-4, abs=2e-9)


def test_commands_that_seem_to_leave_at_once_are_told_apart(simulation):
    """By a clock that drifts past ours: a platform that says when a command left says so of the last one again."""
    drift = iter(range(1000))
    real = Stuttering(
        simulation.platform,
        lambda state: replace(state, received=state.time - 5e-9 * next(drift), commanded=state.time),
    )
    played = real.play(stand(real, 40))
    assert len(played.commands.time) == 40
    assert (np.diff(played.commands.time) > 0).all()


def test_two_platforms_do_not_know_of_each_other(a1):
    for _ in range(2):
        with simulate(a1, "realistic", seed=3) as simulation:
            platform = Stuttering(simulation.platform)
            assert platform.play(stand(platform, 6)).joints.time[0] == simulation.platform.read().time - 6 * 2e-3


def test_a_calibration_goes_through_as_without_lost_samples(a1, tmp_path):
    """It ended by "joint times must be finite and increasing", and with it went the recording."""
    settings = Paper(com_search=ComSearchSettings(tolerance=0.02), sway=SwaySettings(duration=1.0))
    folder = RunFolder.create(tmp_path / "run", a1, settings, {})
    platform, _, truth = simulated(a1)
    with folder, platform:
        result = calibrate(Logged(Stuttering(platform), folder.log), a1, settings, folder.keep)
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


def test_what_cannot_be_made_a_recording_is_on_disk_as_it_was_measured(a1, simulation, tmp_path):
    def broken(state):
        return replace(state, joint_position=np.full(12, np.nan)) if platform._count == 4 else state

    platform = Stuttering(simulation.platform, broken)
    stood = platform.read().joint_position
    folder = RunFolder.create(tmp_path / "run", a1, Paper(), {})
    with pytest.raises(UnrecordedError, match="joint position is not finite at sample") as caught, folder:
        Logged(platform, folder.log).play(stand(platform, 9))
    assert isinstance(caught.value, RecordingError)
    table = json.loads((folder.path / "unrecorded.json").read_text(encoding="utf-8"))
    assert table["joint_names"] == list(a1.joint_names)
    assert len(table["steps"]) == 9
    assert table["steps"][0]["sensed"]["joint_position"] == stood.tolist()
    assert math.isnan(table["steps"][4]["sensed"]["joint_position"][0])
    assert len(table["steps"][8]["sent"]) == 12
