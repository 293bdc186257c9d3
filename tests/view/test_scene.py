"""Contents of a Rerun recording, read back from its file, and the estimates in it."""

import threading

import numpy as np
import pinocchio as pin
import pytest
from rrd import read_rrd

from equipoise import BayesianMethod, ComSearchSettings, PaperMethod, RunFolder, calibrate, nominal_stance, simulate
from equipoise.calibration.routine import estimate
from equipoise.errors import RecordingError
from equipoise.logs.reader import read_log
from equipoise.method.reading import ComEstimate
from equipoise.platform.logged_platform import Logged
from equipoise.recording.event import TRIAL
from equipoise.recording.recording import Recording
from equipoise.recording.trials import Step, WalkTrial, read_trial
from equipoise.robot.model import LEG_NAMES
from equipoise.view.convergence import estimates
from equipoise.view.follow import follow, log_news
from equipoise.view.rerun_scene import estimate_text, plane_piece, trial_title
from equipoise.view.viewer import view

PAPER = PaperMethod(com_search=ComSearchSettings(tolerance=0.01))
PERIOD = 0.04


def shown(path, robot, method, news):
    """Show something in a file; return its entities."""
    view(str(path), "test", robot, method, news, print, threading.Event())
    return read_rrd(path)


@pytest.fixture(scope="module")
def paper_run(a1, tmp_path_factory):
    """Return a run of the paper's method, and its result."""
    folder = RunFolder.create(tmp_path_factory.mktemp("runs") / "paper", a1, PAPER, {})
    with simulate(a1, "ideal", payload="1.5,0.06,0.03,0.05", seed=2) as simulation, folder:
        result = calibrate(Logged(simulation.platform, folder.log), a1, PAPER, folder.keep)
    return folder.path, result


@pytest.fixture(scope="module")
def recordings(paper_run):
    return RunFolder.open(paper_run[0]).recordings()


@pytest.fixture(scope="module")
def converged(a1, recordings):
    """Return the estimates after each trial, with the support planes."""
    return list(iter(estimates(a1, nominal_stance(a1), PAPER, list(recordings)).__next__, None))


@pytest.fixture(scope="module")
def entities(paper_run, a1):
    path = paper_run[0]
    return shown(path / "view.rrd", a1, PAPER, follow(path, lambda: False))


def test_the_estimates_converge_to_the_result(converged, paper_run, recordings):
    result = paper_run[1]
    history = [found for found, _ in converged]
    assert [found.trials for found in history] == list(range(1, 1 + len(recordings)))
    assert np.allclose(history[-1].com[:2], result.composite.com_in_base.values[:2], atol=1e-9)
    widths = np.array([found.half_width[:2] for found in history])
    # Lines lie in their brackets by how fast the robot tipped: where they cross may widen a little what a bracket allows.
    assert (np.diff(widths, axis=0) <= 3e-3).all(), "a bracket does not widen"
    assert widths[-1].max() < 0.2 * widths[0].max()
    assert np.isnan(history[-1].half_width[2]), "two level lines do not determine the height"
    for diagonal, (lower, upper) in history[-1].brackets.items():
        line = result.support_lines[diagonal]
        assert (lower, upper) == pytest.approx((line.lower, line.upper))


def test_the_last_estimate_of_the_bayesian_method_is_its_result(a1, bayesian_run):
    recordings = bayesian_run.recordings[:5]
    coming = estimates(a1, bayesian_run.stance, bayesian_run.settings, recordings)
    newest, planes = list(iter(coming.__next__, None))[-1]
    result = estimate(a1, recordings, bayesian_run.settings)
    assert newest.trials == len(recordings)
    assert np.allclose(newest.com, result.composite.com_in_base.values, atol=1e-9)
    assert np.allclose(newest.half_width, 1.96 * result.composite.com_in_base.stds)
    assert len(planes) >= 4
    for lift in planes:
        assert abs(lift.plane.distance_to(newest.com)) < 0.01
        corners = plane_piece(lift, newest.com, 0.16)
        assert np.allclose([lift.plane.distance_to(corner + newest.com) for corner in corners], 0, atol=1e-9)
        assert np.linalg.norm(np.diff(corners, axis=0), axis=1) == pytest.approx([0.32, 0.16, 0.32])


def test_estimates_of_trials_that_come_later(a1, ideal_motions):
    given = []
    coming = estimates(a1, ideal_motions.stance, BayesianMethod(), given)
    assert next(coming) is None
    given += [ideal_motions.move, ideal_motions.lift]
    assert [next(coming)[0].trials, next(coming)[0].trials, next(coming)] == [1, 2, None]


def test_the_file_holds_the_robot_its_sensors_and_the_estimates(entities, recordings, a1):
    joints = [f"/world/robot/{name}" for name in a1.joint_names]
    moving = ["/world/robot", "/world/robot/com", "/world/feet", "/world/support_line", *joints]
    curves = ["/tilt", "/torque", "/gyroscope", "/accelerometer"]
    for entity in (*moving, *curves):
        times = entities[entity].times
        assert times[0] == pytest.approx(PERIOD, abs=PERIOD), entity
        assert np.diff(times) == pytest.approx(PERIOD, abs=1e-5), "25 pictures a second"
    assert times[-1] == pytest.approx(recordings[-1].joints.time[-1] - recordings[0].joints.time[0], abs=5)
    ends = [recording.joints.time[-1] for recording in recordings]
    for entity in ("/com_half_width", "/world/robot/com/estimate", "/world/robot/com/estimate/lines"):
        assert np.diff(entities[entity].times) == pytest.approx(np.diff(ends), abs=1e-5), "one after each trial"
    assert "/world/robot/com/estimate/ellipsoid" not in entities, "the paper's method has brackets"
    assert len(entities["/trials"].times) == len(recordings)
    assert len(entities["/legend"].column("TextDocument:text")) == 1


def test_the_support_line_the_feet_and_the_tilt_of_each_lift(entities, recordings, paper_run):
    lines, tilt, feet = (entities[name] for name in ("/world/support_line", "/tilt", "/world/feet"))
    start = entities["/trials"].times[0] - next(event.time for event in recordings[0].events if event.name == TRIAL)
    verdicts = [trial.verdict for trial in paper_run[1].trials if trial.kind == "lift"]
    lifts = [recording for recording in recordings if recording.trial.kind == "lift"]
    for recording, verdict in zip(lifts, verdicts, strict=True):
        lower = start + next(event.time for event in recording.events if event.data.get("name") == "lower")
        at = int(np.searchsorted(tilt.times, lower))
        (strip,) = lines.column("LineStrips3D:strips")[at]
        positions = np.array(feet.column("Points3D:positions")[at])
        right, left = {"FL_RR": ("RR", "FL"), "FR_RL": ("FR", "RL")}[recording.trial.diagonal]
        assert np.allclose(strip, positions[[LEG_NAMES.index(right), LEG_NAMES.index(left)]], atol=1e-6)
        assert np.abs(np.array(strip)[:, 2]).max() < 5e-3, "it lies on the floor"
        colours = dict(zip(LEG_NAMES, feet.column("Points3D:colors")[at], strict=True))
        assert colours[right] == colours[left] == 0x2EA05AFF
        turned = tilt.column("Scalars:scalars")[at][0]
        if verdict != "balanced":  # soft legs let the base turn by up to two degrees by themselves
            assert np.sign(turned) == {"forward": 1, "backward": -1}[verdict] or abs(turned) < 2.3
    assert lines.column("LineStrips3D:strips")[0] == [], "before the first lift there is none"
    assert np.isnan(tilt.column("Scalars:scalars")[0][0])


def test_the_com_is_the_model_s_shifted_by_the_estimate(entities, converged, a1, recordings):
    stance = nominal_stance(a1)

    def com(joints):
        return pin.centerOfMass(a1.pinocchio, a1.pinocchio.createData(), a1.configuration(joints))

    start = next(event.time for event in recordings[0].events if event.name == TRIAL) - entities["/trials"].times[0]
    moving = entities["/world/robot/com"]
    at = int(np.searchsorted(moving.times, recordings[3].joints.time[100] - start))
    sensed = recordings[3].joints
    joints = [np.interp(moving.times[at] + start, sensed.time, column) for column in sensed.position.T]
    (place,) = moving.column("Transform3D:translation")[at]
    assert np.allclose(place, com(np.array(joints)), atol=1e-6)
    (shift,) = entities["/world/robot/com/estimate"].column("Transform3D:translation")[-1]
    assert np.allclose(shift, converged[-1][0].com - com(stance.joint_position), atol=1e-6)


def test_the_text_describes_the_trial(entities, a1):
    texts = [text for (text,) in entities["/now"].column("TextDocument:text")]
    assert texts[0] == "## Before the first trial\n**stand**\n\n"
    assert any("**watch**" in text for text in texts)
    titles = [body for (body,) in entities["/trials"].column("TextLog:text")]
    assert titles[0] == f"Trial 1 of about {PAPER.expected_trials(nominal_stance(a1))}: lift FL_RR +0.0 mm"
    assert any(
        text.startswith(f"## {titles[1]}\n**lift**\n\nThe robot unloads and lifts two diagonal feet") for text in texts
    )
    com = [text for (text,) in entities["/com"].column("TextDocument:text")]
    assert com[0] == "From the model file, until the first estimate."
    assert "after 1 trial." in com[1]
    assert "| axis | CoM [mm] | ± half bracket [mm] |" in com[-1]
    assert "| z | **-" in com[-1]
    assert "not estimated" in com[-1]


def test_an_estimate_as_text_and_trials_by_name():
    covariance = 1e-8 * np.eye(3)
    text = estimate_text(ComEstimate(9, np.array([0.01, 0, -0.002]), 1.96e-4 * np.ones(3), covariance, {}))
    assert "| axis | CoM [mm] | ± 95 % interval [mm] |" in text
    assert "| x | **+10.00** | 0.20 |" in text
    assert trial_title(None) == "motion"
    assert trial_title(read_trial({"kind": "motors", "leg": "FL"})) == "motors FL"
    walk = WalkTrial(steps=(Step(("FL", "RR"), 1.0, 1.2),), heading=0.5, found_at=1.0)
    assert trial_title(read_trial(walk.to_data())) == "walk", "one that was found in a log"


def test_a_trial_is_shown_before_it_is_complete(a1, ideal_motions, tmp_path):
    lift = ideal_motions.lift
    watch = next(event.time for event in lift.events if event.data.get("name") == "watch")
    entities = shown(tmp_path / "a.rrd", a1, BayesianMethod(), [([lift.between(-1, watch + 0.1)], [])])
    texts = [text for (text,) in entities["/now"].column("TextDocument:text")]
    assert "**watch**" in texts[-1]
    assert np.isfinite(entities["/tilt"].column("Scalars:scalars")[-1][0])
    assert "/world/robot/com/estimate/ellipsoid" not in entities


def test_the_ellipsoid_contains_95_percent(a1, bayesian_run, tmp_path):
    found = bayesian_run.recordings[:7]
    entities = shown(tmp_path / "a.rrd", a1, bayesian_run.settings, [(found, found)])
    ellipsoid = entities["/world/robot/com/estimate/ellipsoid"]
    halves, turns = ellipsoid.column("Ellipsoids3D:half_sizes"), ellipsoid.column("Ellipsoids3D:quaternions")
    widths = entities["/com_half_width"].column("Scalars:scalars")
    for (half,), (turned,), width in zip(halves, turns, widths, strict=True):
        axes = pin.Quaternion(np.array(turned, dtype=float)).matrix()
        shape = axes @ np.diag(np.square(half)) @ axes.T
        expected = np.array(width) * np.sqrt(7.815) / 1.96 / 1000  # of a normal distribution in three dimensions
        factor = np.sqrt(np.diag(shape)) / expected
        assert factor == pytest.approx(factor[0], rel=1e-3)
        assert factor[0] < 10.01
    assert factor[0] > 5


def test_logs_of_other_programs_show_their_trials(paper_run, a1, tmp_path):
    path = paper_run[0] / "recording_0.mcap"
    entities = shown(tmp_path / "log.rrd", a1, PAPER, [log_news(a1, read_log(path, a1))])
    titles = [body for (body,) in entities["/trials"].column("TextLog:text")]
    assert sum("lift" in title for title in titles) >= 4
    heights = np.array(entities["/world/robot"].column("Transform3D:translation"))[:, 0, 2]
    assert np.median(heights) == pytest.approx(nominal_stance(a1).base_height, abs=0.05)


def test_recordings_without_trials_are_shown(a1, ideal_motions, tmp_path):
    move = ideal_motions.move
    bare = Recording(move.joint_names, move.joints, move.imu)
    entities = shown(tmp_path / "bare.rrd", a1, BayesianMethod(), [([bare], [])])
    assert len(entities["/world/robot"].times) > 10
    assert "/now" not in entities


def test_a_log_without_samples_is_refused(a1, tmp_path):
    with pytest.raises(RecordingError) as error:
        shown(tmp_path / "empty.rrd", a1, BayesianMethod(), [([], [])])
    assert str(error.value) == "there is nothing to show: the log has no samples of joints and IMU"
