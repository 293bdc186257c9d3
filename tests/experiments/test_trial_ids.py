"""Ids of trials in the log."""

import pytest

from equipoise import nominal_stance, simulate
from equipoise.errors import ReachError
from equipoise.experiments.stand import stand_up
from equipoise.platform.logged_platform import Logged
from equipoise.recording.run_log import RunLog
from equipoise.recording.run_log_reader import read_log
from equipoise.recording.trials import StandTrial


@pytest.fixture
def log(tmp_path):
    with RunLog(tmp_path / "log.mcap") as log:
        yield log


@pytest.fixture
def standing(a1, log):
    with simulate(a1, "ideal") as simulation:
        standing, _ = stand_up(Logged(simulation.platform, log), a1, nominal_stance(a1))
        standing.keep = log.keep
        yield standing


def hold(standing, begins=False):
    motion = standing.motion()
    return standing.play((motion.begin(StandTrial()) if begins else motion).hold(0.1))


def ids(log):
    return [play.trial for play in read_log(log.path).plays]


def test_a_trial_has_an_id_from_its_beginning_to_its_recording(standing, log):
    hold(standing)
    standing.take()
    kept = []
    for _ in range(2):
        hold(standing, begins=True)
        hold(standing)
        kept.append(standing.finish())
    hold(standing)
    assert ids(log) == [None, None, 1, 1, 2, 2, None]  # the first stands up
    content = read_log(log.path)
    assert [recording.trial_id for recording in (*kept, *content.recordings)] == [1, 2, 1, 2]
    assert all(one.equals(other) for one, other in zip(kept, content.recordings, strict=True))


def test_each_attempt_has_its_own_id(standing, log):
    hold(standing, begins=True)
    assert standing.take().trial_id == 1
    hold(standing, begins=True)
    assert standing.finish().trial_id == 2
    assert ids(log) == [None, 1, 2]
    assert [recording.trial_id for recording in read_log(log.path).recordings] == [2]


def test_a_rejected_motion_begins_no_trial(standing, log, monkeypatch):
    with monkeypatch.context() as patched:
        patched.setattr(standing._clearance, "first_contact", lambda position: "a link touches another")
        with pytest.raises(ReachError):
            hold(standing, begins=True)
    hold(standing, begins=True)
    assert standing.finish().trial_id == 1
    assert ids(log) == [None, 1]
