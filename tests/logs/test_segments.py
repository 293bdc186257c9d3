"""Segments of a long recording without events, and reasons for the unused rest."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from foreign_logs import as_log, every, shifted, without

from equipoise import nominal_stance, simulate
from equipoise.errors import MotionError, RecordingError
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.experiments.stand import move_to, stand_up
from equipoise.logs.motions.foot_paths import FootPaths
from equipoise.logs.motions.gyroscope import compare_gyroscope
from equipoise.logs.motions.oscillation import find_oscillation
from equipoise.logs.motions.rests import find_rests
from equipoise.logs.motions.segments import find_segments, usable
from equipoise.logs.motions.track import Track, means
from equipoise.recording.gaps import split_at_gaps
from equipoise.recording.recording import ImuStream, JointStream, Recording
from equipoise.recording.runs import true_runs
from equipoise.recording.trials import LiftTrial, PostureTrial
from equipoise.robot.kinematics import inverse_kinematics
from equipoise.robot.model import DIAGONALS, LEG_NAMES

PAUSE = 0.8  # [s]


def logged(platform):
    """Everything that a platform plays from now on."""
    recordings, play = [], platform.play

    def noting(*arguments):
        recordings.append(play(*arguments))
        return recordings[-1]

    platform.play = noting
    return recordings


@pytest.fixture(scope="module")
def stance(a1):
    return nominal_stance(a1)


@pytest.fixture(scope="module")
def outing(a1, stance):
    """A robot that stands up, walks in several ways, moves its body, and lies down; what it did, by when it began."""
    home, began = stance.feet_in_base, {}

    def raised(legs, height):
        feet = np.array(home)
        feet[[leg in legs for leg in LEG_NAMES], 2] += height
        return feet

    def others(legs):
        return tuple(leg for leg in LEG_NAMES if leg not in legs)

    def crawl(motion):
        for leg in ("FL", "RR", "FR", "RL"):
            motion.shift_load(others((leg,)), 0.1).step_feet(raised((leg,), 0.04), 0.15).shift_load(LEG_NAMES, 0.1)

    def trot(motion):
        for pair in [*DIAGONALS.values()] * 4:
            motion.step_feet(raised(others(pair), 0.04), 0.12)

    def pace(motion):
        for side in (("FL", "RL"), ("FR", "RR")) * 3:
            motion.step_feet(raised(side, 0.03), 0.08)

    def lean(motion):
        motion.move_feet(home + [0.0, 0.02, 0.03], 0.6)

    def excitation(motion):
        for _ in range(6):
            motion.move_feet(home + [0.02, 0, 0], 0.2).move_feet(home, 0.2)

    def lift(motion):
        motion.shift_load(DIAGONALS["FR_RL"], 0.12).move_feet(raised(("FL", "RR"), 0.025), 0.12).hold(0.3)
        motion.move_feet(home, 0.25).shift_load(LEG_NAMES, 0.12)

    with simulate(a1, "realistic", seed=3, start="lying") as simulation:
        recordings = logged(simulation.platform)
        standing, feet_at_end = stand_up(simulation.platform, a1, stance)
        for what in (crawl, trot, pace, lean, excitation, lift):
            motion = standing.motion().hold(PAUSE)
            began[what.__name__] = recordings[-1].joints.time[-1] + PAUSE
            what(motion)
            standing.play(motion.hold(PAUSE))
        move_to(standing, feet_at_end)
    return SimpleNamespace(log=as_log(recordings), began=began)


def found_at(segments, time):
    """The segment, other than a rest, that begins within a tenth of a second or so of a time."""
    return min((one for one in segments if one.kind != "rest"), key=lambda one: abs(one.start - time))


def test_every_piece_of_an_outing_is_named(a1, stance, outing):
    segments = find_segments(a1, stance, outing.log)
    expected = {
        "crawl": ("steps", False), "trot": ("walk", True), "pace": ("steps", False), "lean": ("move", True),
        "excitation": ("excitation", True), "lift": ("lift", True),
    }  # fmt: skip
    for what, (kind, used) in expected.items():
        one = found_at(segments, outing.began[what])
        assert (one.kind, one.used) == (kind, used), f"{what}: {one}"
        assert abs(one.start - outing.began[what]) < 0.3
    trot = found_at(segments, outing.began["trot"]).recording.trial.steps
    assert {step.pair for step in trot} == {*DIAGONALS}
    assert "no two feet stand alone for long" in found_at(segments, outing.began["pace"]).reason_unused
    lying = [one for one in segments if one.reason_unused and "it lies" in one.reason_unused]
    assert all(one.kind == "rest" for one in lying)


def test_pieces_cover_the_whole_recording_without_overlaps(a1, stance, outing):
    segments = find_segments(a1, stance, outing.log)
    for one, other in itertools.pairwise(segments):
        assert -1e-9 <= other.start - one.end < 0.03
    assert segments[0].start < outing.log.joints.time[0] + 0.03
    assert segments[-1].end > outing.log.joints.time[-1] - 0.03


def test_a_lift_found_is_the_lift_that_was_made(a1, stance, outing):
    (one,) = [one for one in find_segments(a1, stance, outing.log) if one.kind == "lift"]
    trial = one.recording.trial
    assert isinstance(trial, LiftTrial)
    assert trial.diagonal == "FR_RL"
    rest = one.recording.phase("rest")
    assert rest.joints.time[-1] <= outing.began["lift"] + 0.15
    assert one.recording.complete


def test_all_lifts_and_postures_of_a_calibration_are_found(a1, bayesian_run):
    segments = find_segments(a1, bayesian_run.stance, as_log(bayesian_run.recordings))
    # Feet that are replanted before a move are off the floor for a moment: who reads a log takes that for a lift.
    moved = [one.joints.time[[0, -1]] for one in bayesian_run.recordings if isinstance(one.trial, PostureTrial)]
    steps = [one for one in segments if any(first <= one.start <= last for first, last in moved)]
    lifts = [one for one in segments if one.kind == "lift" and one not in steps]
    ours = [one for one in bayesian_run.recordings if isinstance(one.trial, LiftTrial)]
    assert len(lifts) == len(ours)
    for found, made in zip(lifts, ours, strict=True):
        assert found.recording.trial.diagonal == made.trial.diagonal
        unload = next(event.time for event in made.events if event.data.get("name") == "unload")
        assert -0.05 < found.start - unload < 0.2
    moves = [one for one in segments if one.kind == "move" and one.used]
    for made in (one for one in bayesian_run.recordings if isinstance(one.trial, PostureTrial)):
        start = next(event.time for event in made.events if event.data.get("name") == "move")
        assert min(abs(one.start - start) for one in moves) < 0.15


def test_torques_of_a_rest_are_used_once(a1, bayesian_run):
    spans = [
        recording.phase("rest").joints.time[[0, -1]]
        for recording in usable(find_segments(a1, bayesian_run.stance, as_log(bayesian_run.recordings)))
        if recording.has_phase("rest") and recording.joints.torque is not None
    ]
    spans = sorted(map(tuple, spans))
    assert all(one[1] < other[0] for one, other in itertools.pairwise(spans))


def test_a_recording_is_cut_at_gaps_and_nothing_is_used_across_them(a1, stance, outing):
    log, gap = outing.log, outing.began["lean"] + 0.3
    holed = replace(log, imu=without(log.imu, gap, gap + 0.1))
    segments = find_segments(a1, stance, holed)
    (missing,) = [one for one in segments if one.kind == "gap"]
    assert missing.what == f"no IMU samples for {missing.end - missing.start:.2f} s"
    assert missing.start == pytest.approx(gap, abs=0.01)
    assert found_at(segments, outing.began["lean"]).kind == "motion"
    used = [one.kind for one in segments if one.used and one.recording is not None and one.kind != "rest"]
    assert used == ["walk", "excitation", "lift"]


@pytest.mark.parametrize("time", [0.0, 1_763_712_000.0])
def test_pieces_between_gaps_have_all_samples(outing, time):
    log = replace(outing.log, joints=shifted(outing.log.joints, time), imu=shifted(outing.log.imu, time))
    gap = float(log.imu.time[0]) + 3.0
    holed = replace(log, imu=without(log.imu, gap, gap + 0.1), events=(), commands=None)
    pieces = split_at_gaps(holed)
    assert len(pieces) == 2
    assert sum(len(piece.imu.time) for piece, _ in pieces) == len(holed.imu.time)


def test_a_stamp_that_is_hours_away_costs_no_memory(a1, stance, outing):
    """A clock that was set while the log was written."""
    log, hours = outing.log, 1e8
    joints, imu = (
        type(stream)(**{
            name: np.concatenate([value, value[-1:] + (hours if name == "time" else 0)])
            for name, value in vars(stream).items()
            if value is not None
        })
        for stream in (log.joints, log.imu)
    )  # fmt: skip
    far = replace(log, joints=joints, imu=imu, events=(), commands=None)
    assert compare_gyroscope(a1, stance, far) == compare_gyroscope(a1, stance, replace(log, events=(), commands=None))


# --- what no rest is


def still(a1, joint_position, torque=None, acceleration=(0, 0, 9.81), turning=(0, 0, 0), seconds=2.0):
    """A robot that does not move."""
    time, generator = np.arange(round(seconds * 200)) / 200, np.random.default_rng(0)

    def around(values, noise):
        return np.asarray(values) + noise * generator.standard_normal((len(time), len(values)))

    joints = JointStream(time, around(joint_position, 3e-4), None, None if torque is None else around(torque, 0.1))
    return Recording(a1.joint_names, joints, ImuStream(time, around(turning, 3e-3), around(acceleration, 0.05)))


@pytest.fixture(scope="module")
def legs(a1):
    return LegChains(a1)


def rests_of(a1, stance, recording):
    return find_rests(a1, stance, Track.of(a1, recording, stance.scale.time))


def test_a_robot_that_stands_still_rests_for_all_of_the_time(a1, stance):
    (rest,) = rests_of(a1, stance, still(a1, stance.joint_position, turning=(0.01, -0.02, 0.005)))
    assert rest.standing
    assert rest.end - rest.start == pytest.approx(2.0, abs=0.03)
    np.testing.assert_allclose(rest.angular_velocity_in_base, (0.01, -0.02, 0.005), atol=1e-3)
    np.testing.assert_allclose(rest.up, (0, 0, 1), atol=1e-3)


def test_legs_that_are_folded_carry_no_robot(a1, stance):
    folded = inverse_kinematics(a1, stance.feet_in_base + [0, 0, 0.2], stance.joint_position)
    (rest,) = rests_of(a1, stance, still(a1, folded))
    assert rest.folded
    assert rest.reason_unused == "the legs are folded: it lies, or hangs"


def test_a_raised_paw_is_not_a_rest_on_four_feet(a1, stance):
    feet = np.array(stance.feet_in_base)
    feet[1, 2] += 0.04
    (rest,) = rests_of(a1, stance, still(a1, inverse_kinematics(a1, feet, stance.joint_position)))
    assert rest.reason_unused == "the feet are not on one plane: one is raised by some 40 mm"


def test_a_robot_that_hangs_carries_nothing(a1, stance):
    (rest,) = rests_of(a1, stance, still(a1, stance.joint_position, torque=np.full(12, 0.2)))
    assert "the joint torques carry only" in rest.reason_unused


def test_a_wall_is_not_a_floor(a1, stance):
    (rest,) = rests_of(a1, stance, still(a1, stance.joint_position, acceleration=(6.0, 0, 7.8)))
    assert rest.reason_unused == "the plane of the feet leans by 38 deg against gravity"


def test_an_imu_upside_down_is_named_and_not_taken_for_a_fall(a1, stance):
    with pytest.raises(MotionError, match=r"mounted rotated by roll -?180"):
        find_segments(
            a1, stance, without_time(still(a1, stance.joint_position, acceleration=(0, 0, -9.81), seconds=20))
        )


def without_time(recording):
    """With pauses in it, so that it has several rests."""
    joints, imu = recording.joints, recording.imu
    for start in (3, 7, 11, 15):
        joints, imu = without(joints, start, start + 1), without(imu, start, start + 1)
    return replace(recording, joints=joints, imu=imu)


def test_a_robot_that_never_stands_still(a1, stance, outing):
    walking = outing.log.between(outing.began["trot"] + 0.3, outing.began["trot"] + 1.2)
    (only,) = find_segments(a1, stance, walking)
    assert only.reason_unused == "no rest in it: the robot never stands still on four feet"


# --- what no move and no lift is


def moving(a1, stance, feet_at, turning=(0.0, 0.0, 0.0), force=1.0):
    """A robot at rest, whose feet go somewhere in the base frame within half a second, and at rest again.

    Args:
        feet_at: (4, 3) feet at a fraction of the way.
        force: what the accelerometer reads on the way, over gravity.
    """
    time = np.arange(500) / 200
    part = np.clip((time - 1.0) / 0.5, 0, 1)
    part = part**3 * (10 - 15 * part + 6 * part**2)
    position, near = [], stance.joint_position
    for fraction in part:
        near = inverse_kinematics(a1, feet_at(fraction), near)
        position.append(near)
    generator = np.random.default_rng(0)
    way = ((time > 1.0) & (time < 1.5))[:, None]
    gravity = np.array([0, 0, 9.81]) * np.where(way, force, 1.0)
    noise = generator.standard_normal((500, 3))
    imu = ImuStream(time, np.array(turning) * way + 1e-3 * noise, gravity + 0.02 * noise)
    return Recording(a1.joint_names, JointStream(time, np.array(position)), imu)


def test_feet_that_slide_apart_have_slipped(a1, stance):
    apart = np.array([[0.02, 0, 0], [0.02, 0, 0], [-0.02, 0, 0], [-0.02, 0, 0]])
    segments = find_segments(a1, stance, moving(a1, stance, lambda part: stance.feet_in_base + part * apart))
    (motion,) = [one for one in segments if one.kind != "rest"]
    assert motion.kind == "slip"
    assert motion.reason_unused.startswith("feet slipped by 2")


def test_a_body_that_rises_on_four_feet_is_a_move(a1, stance):
    segments = find_segments(
        a1, stance, moving(a1, stance, lambda part: stance.feet_in_base - part * np.array([0, 0, 0.03]))
    )
    (motion,) = [one for one in segments if one.kind != "rest"]
    assert (motion.kind, motion.reason_unused) == ("move", None)
    assert isinstance(motion.recording.trial, PostureTrial)
    for phase in ("before", "move", "rest"):
        assert motion.recording.has_phase(phase)


@pytest.mark.parametrize(
    ("feet", "force", "kind", "why"),
    [
        (("FL", "RR"), 1.0, "lift", None),
        (("FL", "RR"), 0.1, "steps", "it jumps: no foot is on the floor for a moment"),
        (("FL",), 1.0, "crawl", "no joint torques: times on three feet determine nothing without them"),
        (("FL", "RL"), 1.0, "steps", "feet leave the floor (FL, RL), but no two feet stand alone for long"),
    ],
)
def test_two_diagonal_feet_that_leave_the_floor_are_a_lift_and_others_are_not(a1, stance, feet, force, kind, why):
    up = np.array([[0, 0, 0.03 * (leg in feet)] for leg in LEG_NAMES])
    recording = moving(
        a1, stance, lambda part: stance.feet_in_base + np.sin(np.pi * part) * up + 0.001 * part, force=force
    )
    (motion,) = [one for one in find_segments(a1, stance, recording) if one.kind != "rest"]
    assert (motion.kind, motion.reason_unused) == (kind, why)


def test_feet_rise_with_the_rotation_of_the_gyroscope(a1, stance, legs):
    """Encoders that do not move while the body rolls: the feet of one side seem to rise."""
    recording = moving(a1, stance, lambda part: stance.feet_in_base, turning=(0.2, 0, 0))
    track = Track.of(a1, recording, 1.0)
    rest, *_ = find_rests(a1, stance, track)
    paths = FootPaths.after(legs, track.part(track.indices(rest.end, 2.4)), rest)
    left, right = paths.rise_above(("FR", "RR"))[-1, 0], stance.feet_in_base[0, 1] - stance.feet_in_base[1, 1]
    assert left == pytest.approx(0.1 * right, rel=0.1)
    assert paths.turned[-1] == pytest.approx(0.1, rel=0.05)


# --- clocks


@pytest.mark.parametrize("late", [0.0, 0.03, -0.2])
def test_the_legs_determine_the_imu_clock_offset(a1, bayesian_run, late):
    log = as_log(bayesian_run.recordings)
    found = compare_gyroscope(a1, bayesian_run.stance, replace(log, imu=shifted(log.imu, late)))
    assert found.agrees
    assert found.offset == pytest.approx(-late, abs=5e-3)


def test_a_long_log_is_looked_at_until_there_is_enough_motion(a1, bayesian_run, stance):
    """Three minutes of standing come first: more than one piece."""
    log = as_log(bayesian_run.recordings)
    standing = still(a1, stance.joint_position, seconds=180.0)
    later = replace(
        log, joints=shifted(replace(log.joints, velocity=None, torque=None), 181.0), imu=shifted(log.imu, 181.02)
    )
    found = compare_gyroscope(a1, stance, Recording.concatenate([standing, replace(later, commands=None)]))
    alone = compare_gyroscope(a1, stance, log)
    assert found.agrees
    assert found.offset == pytest.approx(alone.offset - 0.02, abs=2e-3)
    assert found.time == pytest.approx(alone.time, rel=0.02)


@pytest.mark.parametrize(
    ("factor", "question"),
    [
        (180 / np.pi, "is it in degrees per second?"),
        (-1, "do all axes have the wrong sign?"),
        (np.array([1, -1, 1]), "does its y have the wrong sign?"),
    ],
)
def test_a_gyroscope_in_other_units_or_signs_is_named(a1, bayesian_run, factor, question):
    log = as_log(bayesian_run.recordings)
    wrong = replace(log.imu, angular_velocity_in_imu=log.imu.angular_velocity_in_imu * factor)
    with pytest.raises(RecordingError) as raised:
        compare_gyroscope(a1, bayesian_run.stance, replace(log, imu=wrong))
    assert question in str(raised.value)


def test_a_gyroscope_of_another_motion_does_not_agree(a1, bayesian_run):
    log = as_log(bayesian_run.recordings)
    backwards = replace(log.imu, angular_velocity_in_imu=log.imu.angular_velocity_in_imu[::-1])
    assert not compare_gyroscope(a1, bayesian_run.stance, replace(log, imu=backwards)).agrees


def test_a_standing_robot_does_not_determine_the_clock_offset(a1, stance):
    assert compare_gyroscope(a1, stance, still(a1, stance.joint_position)) is None


# --- means, runs, oscillations


def test_means_do_not_depend_on_rates(a1, bayesian_run):
    log = as_log(bayesian_run.recordings)
    mixed = replace(log, joints=every(log.joints, 5), imu=every(log.imu, 3))
    whole, thin = (Track.of(a1, one, 1.0) for one in (log, mixed))
    assert abs(len(whole.time) - len(thin.time)) <= 1
    count = min(len(whole.time), len(thin.time))
    miss = whole.joint_position[:count] - thin.joint_position[:count]
    assert np.sqrt(np.mean(miss**2)) < 2e-3


def test_means_of_straight_lines_are_exact():
    time = np.cumsum(np.random.default_rng(0).uniform(0.001, 0.01, 400))
    edges = np.arange(time[0], time[-1], 0.02)
    found = means(time, np.column_stack([np.full(400, 3.0), 2 * time]), edges)
    np.testing.assert_allclose(found[:, 0], 3.0)
    np.testing.assert_allclose(found[:, 1], edges[1:] + edges[:-1], atol=2e-3)


def test_runs_of_flags():
    assert true_runs(np.array([True, False, True, True])) == [(0, 1), (2, 4)]
    assert true_runs(np.array([False])) == []


def test_an_oscillation_is_found_where_it_is_steady():
    time = np.arange(800) / 100
    envelope = np.clip(np.minimum(time - 1, 7 - time), 0, 1)
    turning = np.column_stack(
        [0.3 * np.sin(2 * np.pi * 1.7 * time), 0.01 * np.cos(time), 0.2 * np.sin(2 * np.pi * 2.4 * time)]
    )
    start, end, frequencies = find_oscillation(time, envelope[:, None] * turning, 1.0)
    assert frequencies == pytest.approx({"roll": 1.7, "yaw": 2.4}, abs=0.15)
    assert 1.0 < start < 2.2
    assert 5.8 < end < 7.0
    noise = np.random.default_rng(0).standard_normal((800, 3))
    assert find_oscillation(time, noise, 1.0) is None
    assert find_oscillation(time, np.zeros((800, 3)), 1.0) is None
