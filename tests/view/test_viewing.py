"""What is shown at a moment: trials, tilt, the CoM closing in, and the words and pictures beside the robot."""

import re
import time
import xml.etree.ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest

from equipoise import ComSearchSettings, Paper, Precise, RunFolder, calibrate, nominal_stance, simulate
from equipoise.calibration.routine import estimate
from equipoise.logs.reader import read_log
from equipoise.platform.logged import Logged
from equipoise.recording.recording import Recording
from equipoise.view.closing_in import ClosingIn, ComEstimate
from equipoise.view.even_steps import STEP
from equipoise.view.film import Film
from equipoise.view.follow import FollowedLog, GivenRecordings
from equipoise.view.frames import Camera, ellipsoid, joint_poses, plane_lines
from equipoise.view.open import Showing, Viewing, open_log, open_run
from equipoise.view.panel import com_text, trial_text
from equipoise.view.plan_view import SIZE, plan_view
from equipoise.view.player import Player

pytestmark = pytest.mark.usefixtures("coarse_engine")

PAPER = Paper(com_search=ComSearchSettings(tolerance=0.01))


@pytest.fixture(scope="module")
def paper_run(a1, tmp_path_factory):
    """A run of the paper's method, and its result."""
    folder = RunFolder.create(tmp_path_factory.mktemp("runs") / "paper", a1, PAPER, {})
    with simulate(a1, "ideal", payload="1.5,0.06,0.03,0.05", seed=2) as simulation, folder:
        result = calibrate(Logged(simulation.platform, folder.log), a1, PAPER, folder.keep)
    return folder.path, result


@pytest.fixture(scope="module")
def viewing(paper_run):
    with Viewing(open_run(paper_run[0])) as viewing:
        assert viewing.refresh(), "the log is closed"
        viewing.settle()
        yield viewing


def test_the_estimate_closes_in_on_what_the_run_found(viewing, paper_run):
    path, result = paper_run
    history = viewing.closing_in.history(99)
    assert [estimate.trials for estimate in history] == list(range(1, 1 + len(RunFolder.open(path).recordings())))
    found = result.composite.com_in_base.values[:2]
    assert np.allclose(history[-1].com[:2], found, atol=1e-9)
    widths = np.array([estimate.half[:2] for estimate in history])
    # Lines lie in their brackets by how fast the robot tipped: where they cross may widen a little what a bracket allows.
    assert (np.diff(widths, axis=0) <= 3e-3).all(), "a bracket does not widen"
    assert widths[-1].max() < 0.2 * widths[0].max()
    assert np.isnan(history[-1].half[2]), "two level lines tell no height"
    for diagonal, (lower, upper) in history[-1].brackets.items():
        line = result.support_lines[diagonal]
        assert (lower, upper) == pytest.approx((line.lower, line.upper))


def test_what_the_precise_method_finds_is_where_its_estimates_end(a1, precise_run):
    settings = precise_run.settings
    with ClosingIn(a1, precise_run.stance, settings) as closing_in:
        closing_in.take(precise_run.recordings)
        end = time.monotonic() + 60
        while closing_in.after(len(precise_run.recordings)) is None and time.monotonic() < end:
            time.sleep(0.05)
        newest = closing_in.after(99)
        assert newest is not None, "the newest comes first"
        assert newest.trials == len(precise_run.recordings)
        result = estimate(a1, precise_run.recordings, settings)
        assert np.allclose(newest.com, result.composite.com_in_base.values, atol=1e-9)
        assert np.allclose(newest.half, 1.96 * result.composite.com_in_base.deviations)
        assert len(closing_in.planes) >= 4
        misses = [lift.plane.distance_to(newest.com) for lift in closing_in.planes]
        assert np.abs(misses).max() < 0.01
        axes, half = ellipsoid(newest)
        assert np.allclose(axes @ np.diag(half**2) @ axes.T, newest.covariance * 7.815)
        assert np.linalg.det(axes) == pytest.approx(1)
        closing_in.take([], anew=True)
        assert closing_in.settled
        assert closing_in.after(99) is None


def test_frames_show_the_trial_its_line_and_its_tilt(viewing, paper_run):
    camera, film = viewing.camera, viewing.film
    lifts = [trial for trial in film.trials if trial.diagonal is not None]
    first, result = lifts[0], paper_run[1]
    before = camera.frame(first.time - 0.1)
    assert (before.trial, before.tilt, before.support_line_in_world, before.complete) == (None, None, None, 0)
    verdicts = [trial for trial in result.trials if trial.kind == "lift"]
    for trial, known in zip(lifts, verdicts, strict=True):
        down = film.phase_start("lower", trial, 1e6) + STEP
        frame = camera.frame(down)
        assert frame.trial == trial
        assert frame.phase == "lower"
        assert frame.complete == trial.number - 1
        if known.verdict != "balanced":  # soft legs let the base turn by up to two degrees by themselves
            assert np.sign(frame.tilt) == {"forward": 1, "backward": -1}[known.verdict] or abs(frame.tilt) < 0.04
        stands = {"FL_RR": [True, False, False, True], "FR_RL": [False, True, True, False]}[trial.diagonal]
        assert frame.standing[stands].all()
        right, left = frame.support_line_in_world
        feet = {"FL_RR": (3, 0), "FR_RL": (1, 2)}[trial.diagonal]
        assert np.allclose([right, left], frame.contacts_in_world[list(feet)])
        assert np.abs(frame.support_line_in_world[:, 2]).max() < 5e-3, "it lies on the floor"
    assert film.method.expected_trials(film.stance) >= len(film.trials)


@pytest.mark.parametrize("late", [0.0, 0.002, 0.004, 0.006, 0.008])
def test_a_trial_that_one_jumps_to_is_the_trial_that_one_sees(a1, precise_run, late):
    film = Film(a1, precise_run.stance, precise_run.settings)
    first, *others = precise_run.recordings
    film.take([first.between(first.joints.time[0] + late, np.inf), *others])
    with ClosingIn(a1, film.stance, film.method) as closing_in:
        camera = Camera(film, closing_in)
        assert len(film.trials) >= len(others)
        assert [camera.frame(film.beginning(trial)).trial for trial in film.trials] == film.trials


def test_the_com_of_a_frame_is_the_model_s_moved_by_what_was_found(viewing, a1):
    frame = viewing.camera.frame(viewing.film.span[1])
    nominal = pin.centerOfMass(
        a1.pinocchio, a1.pinocchio.createData(), a1.configuration(viewing.film.stance.joint_position)
    )
    here = pin.centerOfMass(a1.pinocchio, a1.pinocchio.createData(), a1.configuration(frame.joint_position))
    in_base = frame.rotation_base_to_world.T @ (frame.com_in_world - frame.position_in_world)
    assert np.allclose(in_base, here + frame.estimate.com - nominal)
    poses = joint_poses(viewing.film, frame.joint_position)
    assert np.allclose(poses[0][1], 0)
    assert len(poses) == 13
    lines = plane_lines(frame, viewing.film.stance)
    for line, lift in zip(lines, frame.planes, strict=True):
        for end in line:
            assert lift.plane.distance_to(end + frame.estimate.com) == pytest.approx(0, abs=1e-9)


def test_the_words_say_the_trial_its_tilt_and_the_com(viewing):
    camera, film = viewing.camera, viewing.film
    assert com_text(camera.frame(0.0)) == "**CoM**: by the model, until a trial says more"
    assert trial_text(camera.frame(0.0), 13, False) == "**standing up**"
    second = film.trials[1]
    frame = camera.frame(film.phase_start("lower", second, 1e6) + STEP)
    text = trial_text(frame, 13, False)
    assert text.startswith(f"**Trial 2 of about 13: lift FL_RR {1000 * second.what.offset:+.1f} mm**")
    assert "putting the feet down" in text
    assert "tilt about the line **" in text
    assert "after 1 trial; brackets of the offset:" in com_text(frame)
    last = camera.frame(film.span[1])
    assert trial_text(last, len(film.trials), True) == f"**{len(film.trials)} trials are done**"
    assert "| z | **" in com_text(last)
    assert "by the model" in com_text(last)


def test_the_plan_view_is_a_picture_with_every_line(viewing):
    frame = viewing.camera.frame(viewing.film.span[1])
    history = viewing.closing_in.history(frame.complete)
    html = plan_view(history, frame.planes, np.zeros(3))
    svg = ET.fromstring(html[: html.index("</svg>") + 6])
    tags = [element.tag.split("}")[1] for element in svg]
    assert tags.count("line") == len(frame.planes) > 0
    assert {"polyline", "rect", "circle", "title"} <= set(tags)
    assert "by the model" not in html
    assert "nan" not in html
    assert "nan" not in plan_view([], [], np.zeros(3))


def test_the_plan_views_ellipse_holds_95_percent():
    covariance = np.diag([0.0, 0.0, 1e-7])
    covariance[:2, :2] = 1e-8 * np.array([[9.0, 5.0], [5.0, 4.0]])
    half = 1.96 * np.sqrt(np.diag(covariance))
    html = plan_view([ComEstimate(9, np.zeros(3), half, covariance, {})], [], np.full(3, 5e-3))
    svg = ET.fromstring(html[: html.index("</svg>") + 6])
    ellipse = next(element for element in svg if element.tag.endswith("ellipse"))
    cx, cy, rx, ry = (float(ellipse.get(name)) for name in ("cx", "cy", "rx", "ry"))
    angle = np.radians(float(re.match(r"rotate\((\S+)", ellipse.get("transform"))[1]))
    square = float(re.search(r"a square is (\S+) mm", html)[1])  # four of them are the picture's width
    pixels_per_metre = 1000 * float(svg.get("viewBox").split()[2]) / (4 * square)
    x, y, _ = np.random.default_rng(1).multivariate_normal(np.zeros(3), covariance, 20_000).T * pixels_per_metre
    right, down = -y, -x  # forward is up, left is left
    along, across = np.cos(angle) * right + np.sin(angle) * down, np.cos(angle) * down - np.sin(angle) * right
    assert (cx, cy) == pytest.approx((SIZE / 2, SIZE / 2))
    assert np.mean((along / rx) ** 2 + (across / ry) ** 2 < 1) == pytest.approx(0.95, abs=0.01)


def test_a_run_that_is_written_is_seen_piece_by_piece(a1, ideal_motions):
    stance = nominal_stance(a1)
    camera = None
    film = Film(a1, stance, Precise())
    with ClosingIn(a1, stance, Precise()) as closing_in:
        camera = Camera(film, closing_in)
        assert film.empty
        lift = ideal_motions.lift
        watching = next(event.time for event in lift.events if event.data.get("name") == "watch")
        film.take([lift.between(-1, watching + 0.1)])
        frame = camera.frame(film.span[1])
        assert (frame.complete, frame.phase) == (0, "watch")
        assert frame.tilt is not None


def test_logs_that_are_not_ours_show_the_trials_that_are_found_in_them(paper_run, a1):
    path = paper_run[0] / "recording_0.mcap"
    showing = open_log(path, a1, read_log(path, a1))
    with Viewing(showing) as viewing:
        assert viewing.refresh()
        assert sum(trial.diagonal is not None for trial in viewing.film.trials) >= 4
        assert viewing.film.span[1] > 10
        frame = viewing.camera.frame(viewing.film.trials[0].time + 2)
        assert abs(frame.position_in_world[2] - viewing.film.stance.base_height) < 0.05


def test_recordings_without_trials_can_be_looked_at(a1, ideal_motions):
    move = ideal_motions.move
    bare = Recording(move.joint_names, move.joints, move.imu)
    with Viewing(Showing("a log", a1, Precise(), GivenRecordings(bare))) as viewing:
        assert viewing.refresh()
        frame = viewing.camera.frame(viewing.film.span[0])
        assert (frame.trial, frame.estimate) == (None, None)
        assert trial_text(frame, None, True) == "**before the first trial**"


def test_a_followed_log_of_a_killed_run_is_not_complete(paper_run, tmp_path):
    data = (paper_run[0] / "recording_0.mcap").read_bytes()
    (cut := tmp_path / "recording_0.mcap").write_bytes(data[: len(data) // 2])
    source = FollowedLog(cut)
    assert source.news().recordings
    assert not source.complete


def test_a_player_plays_pauses_scrubs_and_stops_at_the_end():
    player, span = Player(live=False), (10.0, 20.0)
    player.advance(0.5, span, True)
    assert (player.time, player.rate) == (10.5, 1.0)
    player.speed = 2.0
    player.advance(1.0, span, True)
    assert player.time == 12.5
    player.toggle(span)
    player.advance(1.0, span, True)
    assert (player.time, player.rate) == (12.5, 0.0)
    player.jump(19.5)
    player.toggle(span)
    player.advance(1.0, span, True)
    assert (player.time, player.playing) == (20.0, False)
    player.toggle(span)
    assert (player.time, player.playing) == (10.0, True)


def test_a_live_player_stays_close_behind_and_catches_up():
    player, end, shown = Player(live=True), 0.0, []
    for step in range(2000):  # a real robot's log: a quarter of a second of it, every quarter of a second
        end = 0.25 * (step * 0.033 // 0.25)
        player.advance(0.033, (0.0, end), False)
        shown.append((end - player.time, player.rate))
    lags, rates = np.array(shown[300:]).T
    assert lags.min() >= 0
    assert lags.max() < 1.0
    assert rates.max() < 2.0
    assert rates.min() > 0.1, "it never stands still"
    end += 100.0  # somebody opens the page late
    for _ in range(900):
        player.advance(0.033, (0.0, end), False)
    assert end - player.time < 1.0
    player.jump(5.0)
    assert not player.live
