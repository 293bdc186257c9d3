"""A simulated robot that is logged behaves as without, and the log holds what it did."""

import resource
from dataclasses import replace

import numpy as np
import pytest
from logs import bits
from platform_contract import WITHOUT_DELAY, SimulationContract, interrupt_after, wave

from equipoise import simulate
from equipoise.errors import FallError, OutputError
from equipoise.platform.logged_platform import Logged
from equipoise.platform.platform import JointCommand, MotionInterrupted
from equipoise.recording.recording import Recording
from equipoise.recording.run_log import RunLog
from equipoise.recording.run_log_reader import read_log


class TestLogged(SimulationContract):
    tolerances = WITHOUT_DELAY

    @pytest.fixture(autouse=True)
    def _logs(self, tmp_path):
        self.folder, self.logs = tmp_path, []
        yield
        for log in self.logs:
            log.close()

    def make(self):
        self.logs.append(RunLog(self.folder / f"{len(self.logs)}.mcap"))
        return Logged(simulate(self.robot, "ideal", seed=3).platform, self.logs[-1])


@pytest.fixture
def log(tmp_path):
    with RunLog(tmp_path / "recording_0.mcap") as log:
        yield log


@pytest.fixture
def platform(a1, log):
    with Logged(simulate(a1, "ideal").platform, log) as platform:
        yield platform


def logged(log):
    """Return the content of an open log."""
    return read_log(log.path).plays


def test_every_motion_is_in_the_log_when_it_is_over(platform, log):
    played = []
    for count in (50, 700, 1):
        played.append(platform.play(wave(platform, count)))
        assert [bits(play.recording) for play in logged(log)] == [bits(recording) for recording in played]
    assert [play.commands for play in logged(log)] == [50, 700, 1]


def test_the_part_of_a_motion_before_ctrl_c_is_logged(platform, log, monkeypatch):
    interrupt_after(monkeypatch, platform, "_roll", 1)
    with pytest.raises(MotionInterrupted) as caught:
        platform.play(wave(platform, 700))
    (play,) = logged(log)
    assert bits(play.recording) == bits(caught.value.recording)
    assert (play.commands, len(play.recording.joints.time)) == (700, 500)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_what_was_recorded_before_a_guard_ended_a_motion_is_logged(platform, log, monkeypatch, count):
    """Also the ending, which it recorded by itself."""
    whole = platform.play(wave(platform, 100))
    middle = float(whole.joints.time[50])
    parts = (whole.between(-1, middle), whole.between(middle, 1e6))[:count]

    def fall(trajectory, stop=None):
        raise FallError("the base leans by 40 deg", parts)

    monkeypatch.setattr(platform._inner, "play", fall)
    with pytest.raises(FallError):
        platform.play(replace(wave(platform, 200), trial=3))
    assert [(play.commands, play.trial) for play in logged(log)] == [(100, None), (200, 3)][: 1 + bool(count)]
    if count:
        assert bits(logged(log)[1].recording) == bits(Recording.concatenate(parts))


def test_motions_have_the_id_of_their_trial_in_the_log(platform, log):
    for trial in (None, 1, 1, 2):
        platform.play(replace(wave(platform, 20), trial=trial))
    assert [play.trial for play in logged(log)] == [None, 1, 1, 2]


def test_ctrl_c_while_the_log_is_written_loses_no_motion(platform, log, monkeypatch):
    def interrupted(piece):
        raise KeyboardInterrupt

    monkeypatch.setattr(log, "add", interrupted)
    with pytest.raises(MotionInterrupted) as caught:
        platform.play(wave(platform, 40))
    assert len(caught.value.recording.joints.time) == 40


def test_steps_are_logged_a_quarter_of_a_second_at_a_time(platform, log):
    here = platform.read().joint_position
    states = [platform.read()]
    for step in range(300):
        states.append(platform.step(JointCommand(here + 1e-4 * step)))
        assert len(logged(log)) == (0 if step < 124 else 1)
    (play,) = logged(log)
    assert len(play.recording.joints.time) == 250
    platform.play(wave(platform, 20))
    steps, motion = logged(log)
    assert len(motion.recording.joints.time) == 20
    assert len(steps.recording.joints.time) == 300
    assert np.array_equal(steps.recording.commands.position, here + 1e-4 * np.arange(300)[:, None])
    assert np.array_equal(steps.recording.joints.position, [state.joint_position for state in states[:-1]])
    platform.step(JointCommand(here))
    platform.close()
    assert len(logged(log)) == 3
    assert isinstance(Recording.concatenate([play.recording for play in logged(log)]), Recording)  # no moment twice


def test_a_full_disk_ends_the_motion_with_its_error(a1, tmp_path):
    with RunLog(tmp_path / "recording_0.mcap") as log, Logged(simulate(a1, "ideal").platform, log) as platform:
        platform.play(wave(platform, 20))
        limits = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (log.path.stat().st_size + 1000, limits[1]))
        try:
            with pytest.raises(OutputError, match=r"cannot write the recording '.*recording_0.mcap': File too large"):
                platform.play(wave(platform, 20))
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert len(read_log(log.path).plays) == 2  # the motion was written once there was room
