"""Faults of sensors, models and payloads, put into the log of a realistic run: each is noticed and named, or does no harm.

The faults are put in after the run: what a log shows, whatever made it.
"""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from robots import load_text
from scipy.spatial.transform import Rotation

from equipoise import BayesianMethod, ExcitationSettings, calibrate, estimate, load_robot, nominal_stance, simulate
from equipoise.calibration.routine import perform
from equipoise.errors import MissingDependencyError, MotionError, RecordingError
from equipoise.estimator.diagnostics import screening
from equipoise.estimator.diagnostics.checks import shifts_without
from equipoise.estimator.motions import read_motions
from equipoise.estimator.problem import estimate_posterior
from equipoise.estimator.unknowns import Priors
from equipoise.paper.method import estimate_excitations
from equipoise.recording.recording import PHASE
from equipoise.recording.trials import DesignedLift
from equipoise.robot.description import RobotDescription
from equipoise.robot.inertial import components
from equipoise.simulation.effects import REALISTIC

SETTINGS = BayesianMethod(duration=60)
PAYLOAD, SEED = "1.0,0.05,0.02,0.08", 3
MOVED_PAYLOAD = "1.0,-0.02,0.02,0.08"
JOINTS = [f"{leg}_{joint}_joint" for leg in ("FL", "FR", "RL", "RR") for joint in ("hip", "thigh", "calf")]


def recorded(robot, model=None, payload=PAYLOAD, noise="realistic", settings=SETTINGS):
    """Return recordings of a run on a simulated robot with the user's model, and the true body."""
    with simulate(robot, noise, payload, SEED) as simulation:
        return perform(simulation.platform, model or robot, settings).recordings, simulation.truth.composite


def ran(robot, model=None, noise="realistic", settings=SETTINGS):
    """Return the recordings, the true body and the result of a run."""
    recordings, truth = recorded(robot, model, noise=noise, settings=settings)
    result = estimate(model or robot, recordings, settings)
    return SimpleNamespace(recordings=recordings, result=result, truth=truth)


@pytest.fixture(scope="module")
def run(a1):
    return ran(a1)


@pytest.fixture(scope="module")
def leaning(a1):
    """Return recordings that lean about two axes; `run` leans about one, which cannot distinguish some faults."""
    return recorded(a1, settings=replace(SETTINGS, duration=140, cable="none", leg_prior="narrow"))[0]


# --- what faults do to a log


def with_joints(recordings, change, streams=("position", "velocity", "torque")):
    """Return recordings with every joint stream changed by a function of its (n, nj) array."""
    return [
        replace(
            recording, joints=replace(recording.joints, **{s: change(getattr(recording.joints, s)) for s in streams})
        )
        for recording in recordings
    ]


def with_imu(recordings, gyro=lambda v: v, accelerometer=lambda v: v):
    return [
        replace(
            recording,
            imu=replace(
                recording.imu,
                angular_velocity_in_imu=gyro(recording.imu.angular_velocity_in_imu),
                acceleration_in_imu=accelerometer(recording.imu.acceleration_in_imu),
            ),
        )
        for recording in recordings
    ]


def columns(change, *which):
    """Return a change of some columns only."""

    def changed(array):
        array = array.copy()
        array[:, which] = change(array[:, which])
        return array

    return changed


def negated(array):
    return -array


def turned(axis, angle):
    """Return a change to the readings of an IMU rotated by minus the angle [deg]."""
    matrix = Rotation.from_euler(axis, angle, degrees=True).as_matrix()
    return lambda vectors: vectors @ matrix.T


def swapped(robot, *pairs):
    def change(array):
        changed = array.copy()
        for one, other in pairs:
            a, b = list(robot.legs[one].joints), list(robot.legs[other].joints)
            changed[:, a], changed[:, b] = array[:, b], array[:, a]
        return changed

    return change


def frozen(recordings, joint, first=0, sample=0):
    """Return recordings with an encoder that is frozen from a sample of one recording to the end."""
    value = recordings[first].joints.position[sample, joint]
    changed = list(recordings)
    for index in range(first, len(recordings)):
        joints = recordings[index].joints
        position, velocity = joints.position.copy(), joints.velocity.copy()
        since = sample if index == first else 0
        position[since:, joint], velocity[since:, joint] = value, 0.0
        changed[index] = replace(recordings[index], joints=replace(joints, position=position, velocity=velocity))
    return changed


def kept(recording, joint_samples, imu_samples):
    """Return a recording with only some samples."""

    def only(stream, samples):
        arrays = {name: value[samples] for name, value in vars(stream).items() if value is not None}
        return replace(stream, **arrays)

    return replace(recording, joints=only(recording.joints, joint_samples), imu=only(recording.imu, imu_samples))


def without_time(recording, start, end, streams):
    """Return a recording with a gap."""
    keep = {
        name: ~((stream.time >= start) & (stream.time < end) & (name in streams))
        for name, stream in (("joints", recording.joints), ("imu", recording.imu))
    }
    return kept(recording, keep["joints"], keep["imu"])


# --- messages


def largest_error(result):
    """Return the largest error in the message of the check "sensor errors", passed or failed."""
    (message,) = (check.message for check in result.checks if check.name == "sensor errors")
    return message.partition("(limit 4): ")[2]


def failed(result):
    """Return the messages of failed checks by name; the warnings repeat them, in the same order."""
    messages = {check.name: check.message for check in result.checks if not check.passed}
    assert list(result.warnings) == [f"{name}: {message}" for name, message in messages.items()]
    return messages


def assert_harmless(result, run):
    """Assert that no check fails, and that no parameter leaves its interval."""
    assert not failed(result)
    for before, now in zip(run.result.composite, result.composite, strict=True):
        assert before.lower < now.value < before.upper, now.name


# --- no fault


def test_a_run_without_a_fault_raises_no_alarm(run):
    assert not failed(run.result)
    assert run.result.trustworthy


def test_true_values_lie_where_they_should(run):
    off = run.result.composite.values - components(run.truth)
    assert np.abs(off / run.result.composite.stds).max() < 4.0


# --- encoders


@pytest.mark.parametrize("joint", range(12), ids=JOINTS)
def test_an_encoder_that_is_frozen_all_the_time_is_named(a1, run, joint):
    with pytest.raises(RecordingError, match=f"encoder of joint '{a1.joint_names[joint]}' is frozen"):
        estimate(a1, frozen(run.recordings, joint), SETTINGS)


@pytest.mark.parametrize("joint", [0, 4, 8])
def test_an_encoder_that_freezes_in_the_middle_of_a_run_is_named(a1, run, joint):
    middle = len(run.recordings[6].joints.time) // 2
    with pytest.raises(RecordingError, match=f"encoder of joint '{a1.joint_names[joint]}' is frozen"):
        estimate(a1, frozen(run.recordings, joint, 6, middle), SETTINGS)


def test_an_encoder_at_rest_that_reads_the_same_is_not_frozen(a1, run):
    """Coarse encoders: 0.5 mrad."""
    coarse = with_joints(run.recordings, lambda array: np.round(array / 5e-4) * 5e-4, ["position"])
    assert not failed(estimate(a1, coarse, SETTINGS))


def test_velocities_of_joints_that_rest_fail_their_check(a1, run):
    """Gazebo's solver pushes feet out of the floor at every step, and reports joints that rest as moving."""
    moving = np.tile([0.0, 0.2, 0.4], 4)
    found = estimate(a1, with_joints(run.recordings, lambda array: array + moving, ["velocity"]), SETTINGS)
    (check,) = [check for check in found.checks if check.name == "joint velocities"]
    assert not check.passed
    assert re.search("velocity of joint '.._calf_joint' differ from its encoder by 1..% of the motion", check.message)


@pytest.mark.parametrize(
    ("pairs", "named"),
    [
        ([("FL", "FR")], "FL and FR"),
        ([("RL", "RR")], "RL and RR"),
        ([("FL", "RL")], "FL and RL"),
        ([("FL", "RR")], "FL and RR"),
        ([("FL", "RL"), ("FR", "RR")], "of the front and the rear"),
        ([("FL", "FR"), ("RL", "RR")], "of the left and the right side"),
    ],
    ids=str,
)
def test_swapped_legs_are_named(a1, leaning, pairs, named):
    with pytest.raises(RecordingError, match=f"the legs {named} seem to be swapped"):
        estimate(a1, with_joints(leaning, swapped(a1, *pairs)), SETTINGS)


@pytest.mark.parametrize("joint", range(12), ids=JOINTS)
def test_a_joint_with_the_wrong_sign_is_named(a1, leaning, joint):
    with pytest.raises(RecordingError, match=rf"joint '{a1.joint_names[joint]}'.* the wrong sign"):
        estimate(a1, with_joints(leaning, columns(negated, joint)), SETTINGS)


def test_all_hips_with_the_wrong_sign_are_named(a1, run):
    hips = [a1.joint_names.index(name) for name in a1.joint_names if "hip" in name]
    with pytest.raises(RecordingError, match=r"joints FL_hip_joint, .* seem to have the wrong sign"):
        estimate(a1, with_joints(run.recordings, columns(negated, *hips)), SETTINGS)


def test_degrees_are_named(a1, run):
    with pytest.raises(RecordingError, match=r"are joint positions in degrees\?"):
        estimate(a1, with_joints(run.recordings, np.degrees, ["position"]), SETTINGS)
    with pytest.raises(RecordingError, match=r"velocity of joint .* is 5\d times .*degrees per second\?"):
        estimate(a1, with_joints(run.recordings, np.degrees, ["velocity"]), SETTINGS)
    # Wide limits do not show it.
    with pytest.raises(RecordingError, match=r"is 0\.01\d times .*are joint positions in degrees\?"):
        screening._check_velocity(a1, screening._moves(with_joints(run.recordings, np.degrees, ["position"])))


def test_a_velocity_with_the_wrong_sign_is_named(a1, run):
    with pytest.raises(RecordingError, match=r"velocity of joint 'FR_thigh_joint' is -(1|0\.9\d) times .*wrong sign"):
        estimate(a1, with_joints(run.recordings, columns(negated, 4), ["velocity"]), SETTINGS)


def test_a_large_joint_offset_is_named(a1, run):
    moved = with_joints(run.recordings, columns(lambda q: q + 0.1, 4), ["position"])
    result = estimate(a1, moved, SETTINGS)
    assert "an encoder is wrong" in failed(result)["stance motion residuals"]
    assert largest_error(result).startswith("joint offset of FR_thigh_joint")


# --- inertial sensors


@pytest.mark.parametrize(
    ("axis", "angle", "mounted"),
    [
        ("x", 90, "roll -90, pitch 0, yaw 0"),
        ("y", 90, "roll 0, pitch -90, yaw 0"),
        ("z", 90, "roll 0, pitch 0, yaw -90"),
        ("z", 180, "roll 0, pitch 0, yaw 180"),
        ("x", 180, "roll 180, pitch 0, yaw 0"),
    ],
)
def test_a_rotated_imu_is_named_with_its_pose(a1, run, axis, angle, mounted):
    turn = turned(axis, angle)
    with pytest.raises(MotionError, match=f"mounted rotated by {mounted} deg"):
        estimate(a1, with_imu(run.recordings, turn, turn), SETTINGS)


def test_the_pose_that_is_named_cures_it(run):
    turn = turned("z", 90)
    corrected = load_robot("unitree_a1", RobotDescription(imu_rpy=(0.0, 0.0, -np.pi / 2)))
    assert_harmless(estimate(corrected, with_imu(run.recordings, turn, turn), SETTINGS), run)


def test_a_tilted_imu_is_named(a1, run):
    slope = turned("y", 5)
    with pytest.raises(MotionError, match=r"pitch -5, yaw 0 deg relative to the base, or the floor slopes as much"):
        estimate(a1, with_imu(run.recordings, slope, slope), SETTINGS)
    yawed = turned("z", 5)
    assert "IMU tilt in yaw" in failed(estimate(a1, with_imu(run.recordings, yawed, yawed), SETTINGS))["sensor errors"]


def test_gravity_in_g_is_named(a1, run):
    with pytest.raises(RecordingError, match=r"reads 0.99\d at rest; it must read about 9.81 .*in units of g\?"):
        estimate(a1, with_imu(run.recordings, accelerometer=lambda a: a / 9.81), SETTINGS)


@pytest.mark.parametrize(
    ("gyro", "named"),
    [
        (np.degrees, "is it in degrees per second?"),
        (negated, "do all axes have the wrong sign?"),
        (columns(negated, 0), "does its x have the wrong sign?"),
        (lambda rate: rate[:, [1, 0, 2]], "are their axes the same?"),
    ],
)
def test_a_gyroscope_that_the_accelerometer_contradicts_is_named(a1, leaning, gyro, named):
    with pytest.raises(RecordingError, match=re.escape(named)):
        estimate(a1, with_imu(leaning, gyro), SETTINGS)


def test_a_clock_that_is_far_off_is_named(a1, run):
    late = [replace(r, imu=replace(r.imu, time=r.imu.time + 0.015)) for r in run.recordings]
    assert largest_error(estimate(a1, late, SETTINGS)).startswith("clock offset")


# --- torques and the mass


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (negated, "do they have the wrong sign?"),
        (lambda torque: 1000 * torque, "in Nm?"),
        (lambda torque: 0 * torque, "if the robot does not measure them"),
    ],
    ids=["negated", "mNm", "zero"],
)
def test_torques_that_do_not_carry_the_robot_are_named(a1, run, change, named):
    with pytest.raises(RecordingError, match=f"joint torques carry .*{re.escape(named)}"):
        estimate(a1, with_joints(run.recordings, change, ["torque"]), SETTINGS)


def test_one_motor_that_errs_by_half_is_named(a1, run):
    wrong = with_joints(run.recordings, columns(lambda torque: 1.5 * torque, 5), ["torque"])
    assert "torque gain of FR_calf_joint" in failed(estimate(a1, wrong, SETTINGS))["sensor errors"]


@pytest.mark.parametrize("factor", [1.2, 0.8])
def test_a_mass_that_is_wrong_by_a_fifth_is_named(a1, run, factor):
    """With fixed torque constants; otherwise the wrong mass appears as a torque gain, which is named."""
    wrong = BayesianMethod(duration=60, mass=factor * run.truth.mass)
    gains = [found for found in estimate(a1, run.recordings, wrong).sensors if found.name == "torque gain"]
    assert [found.value for found in gains] == pytest.approx([factor - 1], abs=0.06)
    assert gains[0].significant
    messages = failed(estimate(a1, run.recordings, replace(wrong, priors=Priors(torque_gain_common=0.0))))
    assert next(iter(messages)) == "torque-mass consistency"
    error = float(re.search(r"kg: ([+-][\d.]+)%", messages["torque-mass consistency"]).group(1)) / 100
    assert error == pytest.approx(factor - 1, abs=0.06)
    assert "The given mass is wrong, torques are not joint torques in Nm" in messages["torque-mass consistency"]


def test_the_right_mass_raises_no_alarm(a1, run):
    weighed = BayesianMethod(duration=60, mass=run.truth.mass)
    for priors in (Priors(), Priors(torque_gain_common=0.0)):
        assert not failed(estimate(a1, run.recordings, replace(weighed, priors=priors)))


def test_a_robot_without_torques_or_velocities_is_estimated(a1, run):
    bare = with_joints(run.recordings, lambda array: None, ["torque", "velocity"])
    result = estimate(a1, bare, SETTINGS)
    assert not failed(result)
    assert result.composite.mass.verdict == "weak"
    assert "no joint torques" in {check.name: check.message for check in result.checks}["torque-mass consistency"]


# --- samples


@pytest.mark.parametrize("fraction", [0.05, 0.2])
def test_samples_dropped_here_and_there_do_no_harm(a1, run, fraction):
    generator = np.random.default_rng(0)
    dropped = [
        kept(r, generator.random(r.joints.time.size) > fraction, generator.random(r.imu.time.size) > fraction)
        for r in run.recordings
    ]
    assert_harmless(estimate(a1, dropped, SETTINGS), run)


def with_gaps(recordings, count, length, streams):
    """Return recordings with gaps in the middle of the time on two feet of `count` lifts."""
    changed = list(recordings)
    lifts = [index for index, r in enumerate(recordings) if isinstance(r.trial, DesignedLift) and r.trial.turn]
    for index in lifts[:count]:
        starts = {e.data["name"]: e.time for e in recordings[index].events if e.name == PHASE}
        start = starts["lift"] + 0.1
        changed[index] = without_time(recordings[index], start, start + length, streams)
    return changed


@pytest.mark.parametrize("streams", [["joints"], ["imu"], ["joints", "imu"]], ids=str)
def test_a_gap_in_one_lift_does_no_harm(a1, run, streams):
    assert_harmless(estimate(a1, with_gaps(run.recordings, 1, 0.06, streams), SETTINGS), run)


def test_gaps_in_most_lifts_are_named(a1, run):
    messages = failed(estimate(a1, with_gaps(run.recordings, 8, 0.06, ["joints", "imu"]), SETTINGS))
    assert "samples are missing" in messages["sufficient data"]


# --- the robot, its load and the floor


def test_a_payload_that_moves_is_named_with_when_and_by_how_much(a1, run):
    half = len(run.recordings) // 2
    weighed = replace(SETTINGS, mass=run.truth.mass)  # else it looks like another mass too
    moved, _ = recorded(a1, payload=MOVED_PAYLOAD)
    message = failed(estimate(a1, [*run.recordings[:half], *moved[half:]], weighed))["change during the run"]
    found = re.match(r"from motion (\d+) on, CoM x differs by ([+-][\d.]+) m", message)
    assert int(found.group(1)) == pytest.approx(half, abs=3)
    assert float(found.group(2)) == pytest.approx(-0.07 * 1.0 / run.truth.mass, abs=2.5e-3)
    assert "A payload or part moved" in message


def test_feet_that_slip_are_named(a1):
    slippery = replace(REALISTIC.scaled_to(nominal_stance(a1).scale), floor_friction=0.05)
    messages = failed(ran(a1, noise=slippery, settings=BayesianMethod(duration=40)).result)
    assert next(iter(messages)) == "stance motion residuals"
    assert "The feet do not stay in place: they slip" in messages["stance motion residuals"]


@pytest.mark.parametrize(
    ("joint", "legs", "words"),
    [
        (
            "calf_joint",
            ["FL", "FR", "RL", "RR"],
            "thighs or calves are longer or shorter than in the file, in all legs alike",
        ),
        ("foot_joint", ["FL"], "thighs or calves are longer or shorter than in the file"),
    ],
    ids=["all thighs", "one shank"],
)
def test_legs_that_are_longer_than_the_model_are_named(a1, a1_urdf, tmp_path, joint, legs, words):
    """Estimated with wide leg priors; a check fails with narrow ones."""
    text = a1_urdf
    for leg in legs:
        text, changed = re.subn(
            rf'(<joint name="{leg}_{joint}".*?<origin xyz="0 0 )-0.2"', r'\1-0.22"', text, flags=re.S
        )
        assert changed == 1, leg
    longer = ran(load_text(tmp_path, text), model=a1, settings=replace(SETTINGS, duration=95))
    assert f"the run contradicts the model file: {words}" in longer.result.assumptions
    messages = failed(estimate(a1, longer.recordings, replace(SETTINGS, leg_prior="narrow")))
    assert words in messages["fixed-parameter score test"]


# --- legs of two joints


def test_legs_of_two_joints_determine_x_and_z_of_the_com_only(recwarn):
    try:
        robot = load_robot("solo8")
    except MissingDependencyError as error:
        pytest.skip(str(error))
    recordings = []
    with simulate(robot, "realistic", seed=0) as simulation:
        result = calibrate(simulation.platform, robot, SETTINGS, recordings.append)
        off = components(result.composite.parameters()) - components(simulation.truth.composite)
    assert not failed(result)
    com = result.composite.com_in_base
    assert com.x.verdict == com.z.verdict == "identified"
    assert (np.abs(off) < 4 * result.composite.stds).all()
    excitations, _, _ = estimate_excitations(robot, recordings, com.values, nominal_stance(robot), ExcitationSettings())
    for axis in ("roll", "yaw"):
        assert excitations[axis].moment is None
        assert "lacks a joint" in excitations[axis].note
    assert excitations["pitch"].moment > 0


# --- leaving motions out


@pytest.fixture(scope="module")
def posterior(a1, run):
    return estimate_posterior(a1, nominal_stance(a1), read_motions(a1, nominal_stance(a1), run.recordings))


def test_leaving_a_motion_out_shifts_the_estimate_as_estimating_without_it(a1, run, posterior):
    stance = nominal_stance(a1)
    evidence = read_motions(a1, stance, run.recordings)
    for motion in [index for index, m in enumerate(evidence) if m.lift is not None][3:6]:
        ((shift,), _) = shifts_without(posterior, [[motion]])
        others = [m for m in evidence if m.index != motion]
        again = estimate_posterior(a1, stance, others)
        moved = components(again.robot_body) - components(posterior.robot_body)
        # Noise levels are estimated again, which shifts all values slightly.
        assert (np.abs(shift - moved) < 0.6 * np.sqrt(np.diag(posterior.robot_covariance))).all()


def test_leaving_nothing_out_shifts_nothing(posterior):
    shift, stds = shifts_without(posterior, [[]])
    assert not shift.any()
    assert not stds.any()


def test_what_holds_no_evidence_shifts_nothing(posterior):
    assert not shifts_without(posterior, [[10_000]])[0].any()


def test_by_chance_shifts_are_as_large_as_their_deviations_say(posterior):
    _, stds = shifts_without(posterior, [[motion] for motion in posterior.information])
    assert 0.2 < np.sqrt(np.mean(stds**2)) < 1.5
