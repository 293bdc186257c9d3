"""Logs that grow are followed, and the base's motion comes out of them."""

import itertools
import shutil
import subprocess
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest
from logs import kill

from equipoise import Precise, nominal_stance, simulate
from equipoise.errors import RecordingError
from equipoise.experiments.stand import stand_up
from equipoise.platform.stepping import play_by_stepping
from equipoise.platform.wrapper import PlatformWrapper
from equipoise.precise.lift_design import LiftDesign
from equipoise.precise.trials import PreciseTrials
from equipoise.recording.recording import Recording
from equipoise.recording.run_log import RunLog, resume_log
from equipoise.recording.run_log_reader import read_log
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.posture import BodyPosture
from equipoise.view.base_motion import BaseTracker
from equipoise.view.even_steps import STEP, EvenSteps
from equipoise.view.film import Film
from equipoise.view.follow import FollowedLog

pytestmark = pytest.mark.usefixtures("coarse_engine")

WRITER = """
import sys, time
from pathlib import Path
from equipoise.recording.run_log import RunLog
from equipoise.recording.run_log_reader import read_log
source, target, seen = map(Path, sys.argv[1:])
content = read_log(source)
with RunLog(target) as log:
    for play in content.plays:
        log.begin(play.commands, play.trial)
        middle = play.recording.joints.time[len(play.recording.joints.time) // 2]
        for part in (play.recording.between(-1, middle), play.recording.between(middle, 1e6)):
            log.add(part)
            end = time.monotonic() + 20
            while not seen.exists() and time.monotonic() < end:  # however slowly it is read
                time.sleep(0.002)
        for recording in content.recordings:
            if play.trial == recording.trial_id:
                log.keep(recording)
"""


@pytest.fixture(scope="module")
def log(ideal_motions, tmp_path_factory):
    """A move and a lift, cut into pieces, kept."""
    path = tmp_path_factory.mktemp("log") / "recording_0.mcap"
    with RunLog(path) as log:
        for recording in (ideal_motions.move, ideal_motions.lift):
            log.keep(recording)
    return path


def followed(source, until, patience=20.0, seen=None):
    """Pieces and recordings until something, and how often there were any; a file is made when the first are seen."""
    pieces, recordings, looks = [], [], 0
    end = time.monotonic() + patience
    while not until(source) and time.monotonic() < end:
        news = source.news()
        pieces, recordings = pieces + list(news.pieces), recordings + list(news.recordings)
        looks += bool(news.pieces)
        if looks and seen is not None:
            seen.touch()
        time.sleep(0.005)
    return pieces, recordings, looks


def test_a_log_is_followed_while_another_process_writes_it(log, tmp_path):
    target = tmp_path / "growing.mcap"
    source = FollowedLog(target)
    assert not source.news().pieces, "it is not there yet"
    seen = tmp_path / "seen"
    writer = subprocess.Popen([sys.executable, "-c", WRITER, str(log), str(target), str(seen)])
    pieces, recordings, looks = followed(source, lambda source: source.complete, 40.0, seen)
    assert writer.wait(timeout=10) == 0
    assert looks > 1, "it was read while it was written"
    expected = read_log(log).recordings
    assert len(recordings) == len(expected) == 2
    assert all(one.equals(other) for one, other in zip(recordings, expected, strict=True))
    assert Recording.concatenate(pieces).equals(Recording.concatenate(expected))


def test_a_log_cut_anywhere_gives_what_is_whole_and_later_the_rest(log, tmp_path):
    data, target = log.read_bytes(), tmp_path / "cut.mcap"
    source, samples = FollowedLog(target), 0
    for end in np.linspace(3, len(data), 40).astype(int):
        target.write_bytes(data[:end])  # the same file, longer: its number stays
        samples += sum(len(piece.joints.time) for piece in source.news().pieces)
    assert samples == sum(len(recording.joints.time) for recording in read_log(log).recordings)
    assert source.complete


def test_a_run_that_is_resumed_is_shown_without_what_is_played_again(log, tmp_path):
    shutil.copy(log, tmp_path / "recording_0.mcap")
    lift = read_log(log).recordings[1]
    source = FollowedLog(tmp_path)
    assert source.news().pieces
    assert source.complete
    first, _ = resume_log(tmp_path, repeats=True)
    first.begin(10, 1)
    first.add(lift.between(-1, 1e6))
    news = source.news()
    assert news.anew
    assert not source.complete
    assert (len(news.pieces), len(news.recordings)) == (3, 2)
    kill(first)
    second, _ = resume_log(tmp_path, repeats=True)
    news = source.news()
    assert news.anew
    assert (len(news.pieces), len(news.recordings)) == (2, 2)
    second.keep(lift)
    second.close()
    news = source.news()
    assert not news.anew
    assert [recording.equals(lift) for recording in news.recordings] == [True]
    assert source.complete


def test_what_is_no_log_is_refused_by_name(tmp_path):
    (path := tmp_path / "x.mcap").write_bytes(b"not at all")
    with pytest.raises(RecordingError) as error:
        FollowedLog(path).news()
    assert str(error.value) == f"the recording {str(path)!r} cannot be read: it is not an MCAP file"


class Witnessed(PlatformWrapper):
    """Steps, and looks at the truth every ten milliseconds."""

    def __init__(self, simulation):
        super().__init__(simulation.platform)
        self._look, self.seen, self.recordings, self._count = simulation.witness.look, [], [], 0

    def step(self, command):
        if self._count % 5 == 0:
            self.seen.append(self._look())
        self._count += 1
        return self._inner.step(command)

    def play(self, trajectory, stop=None):
        self.recordings.append(play_by_stepping(self, trajectory, stop))
        return self.recordings[-1]


def witnessed(robot, noise):
    stance = nominal_stance(robot)
    com = composite_parameters(robot, stance.joint_position).com + [0.01, 0, 0]  # so that it tips
    with simulate(robot, noise, seed=5) as simulation:
        platform = Witnessed(simulation)
        planted, _ = stand_up(platform, robot, stance)
        trials = PreciseTrials(planted, stance, com)
        trials.lift(LiftDesign(BodyPosture(), "FL_RR", 0))
        trials.take_posture(BodyPosture(roll=0.15, yaw=0.25, crouch=0.1))
        trials.lift(LiftDesign(BodyPosture(roll=0.15, yaw=0.25, crouch=0.1), "FR_RL", 1, "roll"))
    return SimpleNamespace(stance=stance, seen=platform.seen, recordings=platform.recordings)


def tracked(robot, run):
    """What the sensors say, at the times of the truth, where it begins."""
    even, tracker, parts = EvenSteps(robot), BaseTracker(robot, run.stance), []
    for recording in run.recordings:
        if (steps := even.take(recording)) is not None:
            parts.append((steps, tracker.follow(steps)))
    time = np.concatenate([steps.time for steps, _ in parts])
    feet, rotation, standing = (
        np.concatenate([getattr(base, name) for _, base in parts])
        for name in ("feet_in_world", "rotation_base_to_world", "standing")
    )
    truth = [glimpse for glimpse in run.seen if time[0] <= glimpse.time <= time[-1]]
    at = np.searchsorted(time - STEP / 2, [glimpse.time for glimpse in truth], side="right") - 1  # the nearest
    true_feet = np.array([glimpse.feet for glimpse in truth])
    return SimpleNamespace(
        truth=truth, true_feet=true_feet, feet=feet[at], rotation=rotation[at], standing=standing[at], time=time
    )


@pytest.mark.parametrize(("noise", "place", "tilt"), [("ideal", 1e-3, 8e-3), ("realistic", 4e-3, 10e-3)])
def test_the_base_is_where_the_simulated_robot_has_it_also_during_lifts(a1, noise, place, tilt):
    run = witnessed(a1, noise)
    seen = tracked(a1, run)
    # Where it began in the room, and looking where to, nobody can know.
    start, began = seen.feet[0], seen.true_feet[0]
    one, other = start - start.mean(axis=0), began - began.mean(axis=0)
    angle = np.arctan2((one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]).sum(), (one[:, :2] * other[:, :2]).sum())
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    feet = (seen.feet - start.mean(axis=0) * [1, 1, 0]) @ turn.T + began.mean(axis=0) * [1, 1, 0]
    error = feet - seen.true_feet
    assert np.linalg.norm(error, axis=2).max() < 3 * place, "any foot at any time"
    assert np.sqrt((error**2).sum(axis=2).mean()) < place
    up = np.array([glimpse.up for glimpse in seen.truth])
    true_tilt = np.array([glimpse.tilt for glimpse in seen.truth])
    felt = np.arccos(np.clip(seen.rotation[:, 2, 2], -1, 1))
    assert np.abs(felt - true_tilt).max() < tilt
    assert up[:, 2].min() > 0.99
    in_air = np.array([glimpse.clearance for glimpse in seen.truth]) > 6e-3
    assert in_air.any()
    assert seen.standing[in_air].max() < 0.5


def test_even_steps_do_not_depend_on_how_a_recording_is_cut(a1, ideal_motions):
    recording = ideal_motions.lift
    whole = EvenSteps(a1).take(recording)
    even, parts = EvenSteps(a1), []
    edges = [-1.0, *np.linspace(recording.joints.time[0], recording.joints.time[-1], 23)[1:-1], 1e6]
    for start, end in itertools.pairwise(edges):
        if (steps := even.take(recording.between(start, end))) is not None:
            parts.append(steps)
    for name in ("time", "joint_position", "joint_torque", "angular_velocity_in_base", "specific_force_in_base"):
        joined = np.concatenate([getattr(part, name) for part in parts])
        assert np.allclose(joined, getattr(whole, name), atol=1e-9), name
    assert np.allclose(np.diff(whole.time), STEP)


def test_a_film_of_pieces_is_the_film_of_the_whole(a1, ideal_motions):
    recording = ideal_motions.lift
    whole, cut = (Film(a1, ideal_motions.stance, Precise()) for _ in range(2))
    whole.take([recording], [recording])
    middle = float(recording.joints.time[700])
    cut.take([recording.between(-1, middle)])
    cut.take([recording.between(middle, 1e6)], [recording])
    assert np.allclose(cut.moments.position_in_world, whole.moments.position_in_world, atol=1e-9)
    assert (cut.trials, cut.phases, cut.ends) == (whole.trials, whole.phases, whole.ends)
    assert [trial.title for trial in whole.trials] == ["lift FL_RR roll"]
