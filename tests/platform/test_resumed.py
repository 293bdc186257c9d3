"""Interrupted runs that are resumed: in simulation, and as on a real robot."""

import dataclasses
import itertools

import numpy as np
import pytest
from logs import bits, kill
from platform_contract import TO_ROUNDING, SimulationContract, SteppedRobot

from equipoise import ComSearchSettings, ExcitationSettings, PaperMethod, RunFolder, calibrate, simulate
from equipoise.errors import RecordingError
from equipoise.motors.method import Motors
from equipoise.platform.logged_platform import Logged
from equipoise.platform.resumed import RepeatedSimulation, ResumedRobot
from equipoise.platform.stepped import PlatformWrapper
from equipoise.recording.recording import PHASE, TRIAL
from equipoise.recording.run_log_reader import LogContent

SETTINGS = PaperMethod(com_search=ComSearchSettings(tolerance=0.04), excitation=ExcitationSettings(duration=0.7))
PAYLOAD = "1,0.03,0.02,0.06"
NOTHING = LogContent()


class TestResumedRobotWithNothingToSpare(SimulationContract):
    noise, tolerances = "realistic", TO_ROUNDING

    def make(self):
        return ResumedRobot(super().make(), NOTHING)


class Killed(BaseException):
    """The end of a killed process."""


class Mortal(PlatformWrapper):
    """A robot whose program is killed when it is about to play a motion."""

    def __init__(self, inner, motions):
        super().__init__(inner)
        self._left = motions

    def play(self, trajectory, stop=None):
        self._left -= 1
        if self._left < 0:
            raise Killed
        return super().play(trajectory, stop)


def keeper(folder):
    """Keeps what a killed process would have kept."""
    return lambda recording: recording.broken or folder.keep(recording)


def die(folder):
    """Return the run folder after a kill."""
    kill(folder.log)
    folder._log = None


def begin(path, a1, motions):
    folder = RunFolder.create(path, a1, SETTINGS, {})
    with simulate(a1, "realistic", PAYLOAD, seed=5) as simulation:
        platform = Mortal(Logged(simulation.platform, folder.log), motions)
        with pytest.raises(Killed):
            calibrate(platform, a1, SETTINGS, keeper(folder))
    die(folder)


def go_on_simulated(path, a1, motions=10**6):
    folder, content = RunFolder.resume(path, repeats=True)
    with simulate(a1, "realistic", PAYLOAD, seed=5) as simulation:
        live = Logged(simulation.platform, folder.log)
        platform = Mortal(RepeatedSimulation(live, simulation.platform, content), motions)
        try:
            return calibrate(platform, a1, SETTINGS, keeper(folder))
        except Killed:
            return None
        finally:
            die(folder) if motions < 10**6 else folder.close()


@pytest.fixture(scope="module")
def whole(a1, tmp_path_factory):
    """An uninterrupted run: its folder and its result."""
    path = tmp_path_factory.mktemp("whole") / "run"
    with (
        RunFolder.create(path, a1, SETTINGS, {}) as folder,
        simulate(a1, "realistic", PAYLOAD, seed=5) as simulation,
    ):
        result = calibrate(Logged(simulation.platform, folder.log), a1, SETTINGS, folder.keep)
    return folder, result


# --- in simulation


def test_a_simulated_run_ends_as_if_nothing_had_happened(a1, tmp_path, whole):
    path = tmp_path / "run"
    begin(path, a1, 1)
    for motions in (15, 3, 19):
        go_on_simulated(path, a1, motions)
    result = go_on_simulated(path, a1)
    expected, expected_result = whole[0].read(), whole[1]
    assert result.to_json() == expected_result.to_json()
    content = RunFolder.open(path).read()
    assert content.closed
    assert [bits(recording) for recording in content.recordings] == [
        bits(recording) for recording in expected.recordings
    ]
    assert [bits(play.recording) for play in content.plays] == [bits(play.recording) for play in expected.plays]


def test_a_simulation_that_differs_is_reported(a1, tmp_path):
    begin(tmp_path / "run", a1, 12)
    folder, content = RunFolder.resume(tmp_path / "run", repeats=True)
    with folder, simulate(a1, "realistic", PAYLOAD.replace("1,", "1.0001,"), seed=5) as simulation:
        platform = RepeatedSimulation(Logged(simulation.platform, folder.log), simulation.platform, content)
        with pytest.raises(
            RecordingError, match="standing up differs from its recording: a simulation repeats exactly only with"
        ):
            calibrate(platform, a1, SETTINGS, folder.keep)
    assert len(RunFolder.open(tmp_path / "run").recordings()) == len(content.recordings)  # and nothing is lost


@pytest.mark.parametrize("robot", ["simulated", "real"])
def test_other_settings_are_reported_with_the_trial_that_they_change(a1, tmp_path, robot):
    begin(tmp_path / "run", a1, 12)
    other = dataclasses.replace(SETTINGS, com_search=ComSearchSettings(tolerance=0.04, lower=-0.055))
    folder, content = RunFolder.resume(tmp_path / "run", repeats=True)
    assert len(content.recordings) == 2
    with folder, simulate(a1, "realistic", PAYLOAD, seed=5) as simulation:
        live = Logged(simulation.platform, folder.log)
        platform = RepeatedSimulation(live, simulation.platform, content)
        if robot == "real":
            platform = ResumedRobot(live, content)
        with pytest.raises(
            RecordingError, match=r"the commands of trial 1 \(lift FL_RR\) differ from the recorded ones"
        ):
            calibrate(platform, a1, other, folder.keep)


def test_recordings_that_the_routine_does_not_request_again_are_reported(a1, tmp_path):
    begin(tmp_path / "run", a1, 12)
    folder, content = RunFolder.resume(tmp_path / "run", repeats=True)
    with folder:
        folder.keep(content.recordings[0])
        with pytest.raises(RecordingError, match="does not reproduce its recordings"):
            folder.keep(content.recordings[0])


# --- on a real robot


class RealRobot(SteppedRobot):
    """A robot for each program that connects, with a clock that continues; it records the commands."""

    def __init__(self, a1, seed, clock):
        super().__init__(simulate(a1, "realistic", PAYLOAD, seed=seed).platform)
        self._clock, self.sent = clock, []

    def read(self):
        return self._later(super().read())

    def step(self, command):
        self.sent.append(command)
        return self._later(super().step(command))

    def _later(self, state):
        return dataclasses.replace(state, time=state.time + self._clock)


@pytest.fixture(scope="module")
def resumed(a1, tmp_path_factory):
    """A real run that was killed twice: its folder, its robots, its result, and what the log held between."""
    path = tmp_path_factory.mktemp("real") / "run"
    robots, contents, result = [], [], None
    for life, motions in enumerate((10, 18, 10**6)):
        robot = RealRobot(a1, seed=5, clock=1000.0 * life)
        robots.append(robot)
        if life == 0:
            folder, content = RunFolder.create(path, a1, SETTINGS, {}), NOTHING
        else:
            folder, content = RunFolder.resume(path, repeats=False)
        contents.append(content)
        platform = Mortal(ResumedRobot(Logged(robot, folder.log), content), motions)
        try:
            result = calibrate(platform, a1, SETTINGS, keeper(folder))
            folder.close()
        except Killed:
            die(folder)
        robot.close()
    return path, robots, contents, result


def test_a_real_run_keeps_its_recordings_and_goes_on(resumed):
    path, _, contents, result = resumed
    first, second = len(contents[1].recordings), len(contents[2].recordings)
    assert 0 < first < second
    content = RunFolder.open(path).read()
    assert len(content.recordings) > second
    for before in contents[1:]:
        for recording, now in zip(before.recordings, content.recordings, strict=False):
            assert bits(recording) == bits(now)
    lives = [recording.joints.time[0] // 1000 for recording in content.recordings]
    assert lives == sorted(lives)
    assert {0.0, 1.0, 2.0} == set(lives)
    assert RunFolder.open(path).estimate().to_json() == result.to_json()


def test_a_real_run_loses_nothing_that_it_measured(resumed):
    path, robots, _, _ = resumed
    samples = sum(len(play.recording.joints.time) for play in RunFolder.open(path).read().plays)
    assert samples == sum(len(robot.sent) for robot in robots)


def test_the_robot_is_spared_what_is_recorded_and_joins_in_smoothly(resumed):
    path, robots, _, _ = resumed
    plays = RunFolder.open(path).read().plays
    lives = [list(life) for _, life in itertools.groupby(plays, lambda play: play.recording.joints.time[0] // 1000)]
    for life, robot in zip(lives[1:], robots[1:], strict=True):
        stand, way, trial = (play.recording for play in life[:3])
        assert stand.has_phase("stand")
        assert way.has_phase("resume")
        assert way.duration == pytest.approx(2.0, abs=0.01)
        assert any(event.name == TRIAL for event in trial.events)
        sent = np.array([command.position for command in robot.sent])
        begin, end = len(stand.joints.time), len(stand.joints.time) + len(way.joints.time)
        assert np.abs(np.diff(sent[begin - 1 : end + 1], axis=0)).max() < 2e-3  # [rad] in a period: about 1 rad/s
        assert np.allclose(way.commands.position[-1], trial.commands.position[0], atol=2e-3)
        torque = np.array([command.torque for command in robot.sent])
        assert np.abs(np.diff(torque[begin - 1 : end + 1], axis=0)).max() < 0.2


def test_a_real_run_is_as_good_as_one_that_was_not_interrupted(resumed, whole):
    found, expected = (result.composite.com_in_base.values for result in (resumed[3], whole[1]))
    assert np.allclose(found[:2], expected[:2], atol=4e-3)


def test_standing_up_and_the_way_back_belong_to_no_trial(resumed):
    content = RunFolder.open(resumed[0]).read()
    for play in content.plays:
        names = [event.data.get("name") for event in play.recording.events if event.name == PHASE]
        if {"stand", "resume"} & set(names):
            assert play.trial is None


def test_a_robot_that_swung_its_legs_does_not_lie_down_for_it_again(a1, tmp_path):
    """The trial begins with the way down: all of it is spared, or nothing."""
    method = Motors(motor_time=3.0)
    with (
        RunFolder.create(tmp_path / "run", a1, method, {}) as folder,
        simulate(a1, "realistic", seed=5) as simulation,
    ):
        result = calibrate(Logged(simulation.platform, folder.log), a1, method, folder.keep)
    content = RunFolder.open(tmp_path / "run").read()
    robot = RealRobot(a1, seed=6, clock=1000.0)
    assert calibrate(ResumedRobot(robot, content), a1, method).motors == result.motors
    assert not any(command.kp is not None for command in robot.sent)  # as in a swing
