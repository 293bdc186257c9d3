"""Samples on two feet, from recordings with known times, motions and noise."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from equipoise import nominal_stance
from equipoise.errors import RecordingError
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.measurements.lift_samples import REACH, LiftSamples, attitudes, read_lift
from equipoise.recording.recording import PHASE, TRIAL, Event, ImuStream, JointStream, Recording
from equipoise.robot.kinematics import foot_positions, inverse_kinematics
from equipoise.robot.model import DIAGONALS, LEG_NAMES

RATE = 500
BIAS = np.array([0.004, -0.003, 0.002])
REST, LIFT, LOWER = 0.1, 0.5, 1.2  # [s] where these phases begin
UP, RISE = 0.024, 0.1  # [m], [s]


@pytest.fixture(scope="module")
def stance(a1):
    return nominal_stance(a1)


def made_lift(a1, stance, diagonal="FL_RR", height=UP, noise=0.0, velocities=True, up_for=0.58, seed=0):
    """Return a lift: two feet rise at LIFT within RISE and return; the base rests and its gyroscope is biased."""
    time, generator = np.arange(round(1.5 * RATE)) / RATE, np.random.default_rng(seed)
    raised = np.array(stance.feet_in_base)
    raised[[leg not in DIAGONALS[diagonal] for leg in LEG_NAMES], 2] += height
    way = inverse_kinematics(a1, raised, stance.joint_position) - stance.joint_position
    part = smooth((time - LIFT) / RISE) - smooth((time - LIFT - up_for) / RISE)
    position = stance.joint_position + np.outer(part, way)
    velocity = np.gradient(position, time, axis=0) + 100 * noise * generator.standard_normal(position.shape)
    joints = JointStream(
        time, position + noise * generator.standard_normal(position.shape), velocity if velocities else None
    )
    gyro = BIAS + 10 * noise * generator.standard_normal((len(time), 3))
    acceleration = [0, 0, 9.81] + 100 * noise * generator.standard_normal((len(time), 3))
    imu = ImuStream(time, gyro, acceleration)
    phases = {"move": 0.0, "rest": REST, "unload": 0.4, "lift": LIFT, "lower": LOWER}
    events = [Event(0.0, TRIAL, {"kind": "lift", "diagonal": diagonal})]
    events += [Event(start, PHASE, {"name": name}) for name, start in phases.items()]
    return Recording(a1.joint_names, joints, imu, None, tuple(events))


def smooth(part):
    part = np.clip(part, 0, 1)
    return part**3 * (10 - 15 * part + 6 * part**2)


def read(a1, stance, recording):
    return read_lift(a1, LegChains(a1), recording, recording.trial.diagonal, stance, BIAS)


# --- attitudes


def test_a_constant_rotation_is_integrated_exactly():
    time, turning = np.linspace(2.0, 3.0, 101), np.array([0.8, -1.1, 0.5])
    found = attitudes(time, np.tile(turning, (101, 1)))
    np.testing.assert_allclose(
        found.as_matrix(), Rotation.from_rotvec(np.outer(time - 2.0, turning)).as_matrix(), atol=1e-12
    )


def test_a_rotation_about_changing_axes_matches_scipy():
    time = np.linspace(0, 0.6, 601)
    path = Rotation.from_euler("ZYX", np.column_stack([0.7 * time, 0.3 * np.sin(5 * time), 0.4 * time**2]))
    ahead, behind = (
        Rotation.from_euler("ZYX", np.column_stack([0.7 * t, 0.3 * np.sin(5 * t), 0.4 * t**2]))
        for t in (time + 1e-6, time - 1e-6)
    )
    turning = (behind.inv() * ahead).as_rotvec() / 2e-6  # in the body's axes
    found = attitudes(time, turning)
    expected = path[0].inv() * path
    assert (found.inv() * expected).magnitude().max() < 1e-6
    # The other way round would be a rotation from the first axes to the later ones.
    assert (found * expected).magnitude().max() > 0.1


# --- the time on two feet


@pytest.mark.parametrize(("diagonal", "feet"), [("FL_RR", ("FL", "RR")), ("FR_RL", ("RL", "FR"))])
def test_the_left_stance_foot_comes_first(a1, stance, diagonal, feet):
    lift = read(a1, stance, made_lift(a1, stance, diagonal))
    assert isinstance(lift, LiftSamples)
    assert tuple(LEG_NAMES[foot] for foot in lift.stance_feet) == feet
    left, right = (stance.feet_in_base[foot] for foot in lift.stance_feet)
    assert left[1] > right[1]


@pytest.mark.parametrize("diagonal", list(DIAGONALS))
def test_the_samples_are_those_with_both_feet_in_the_air(a1, stance, diagonal):
    recording = made_lift(a1, stance, diagonal)
    lift = read(a1, stance, recording)
    standing = [leg in DIAGONALS[diagonal] for leg in LEG_NAMES]
    clear = 2.5e-3 * stance.hip_height / 0.312

    def above(position):
        return (foot_positions(a1, position) - stance.feet_in_base)[~np.array(standing), 2].min()

    assert min(above(position) for position in lift.joint_position) > clear
    in_air = np.array([above(position) > clear for position in recording.joints.position])
    first, last = recording.joints.time[in_air][[0, -1]]
    assert -1e-9 < lift.start - REACH - first < 0.02
    assert 0 <= last - REACH - (lift.start + lift.step * (len(lift.joint_position) - 1)) < 0.025


def test_joints_are_smoothed_and_the_gyroscope_bias_is_subtracted(a1, stance):
    """Means are compared with Gaussian weights of the same width."""
    recording = made_lift(a1, stance)
    lift = read(a1, stance, recording)
    time = lift.start + lift.step * np.arange(len(lift.joint_position))
    later = REACH * np.linspace(-1, 1, 41)
    weights = np.exp(-(later**2) / (2 * (later[-1] / 3.06) ** 2))
    weights /= weights.sum()
    for found, recorded, close in (
        (lift.joint_position, recording.joints.position, 2e-4),
        (lift.joint_velocity, recording.joints.velocity, 0.05),
    ):
        near = time[:, None] + later
        expected = np.column_stack([np.interp(near, recording.joints.time, column) @ weights for column in recorded.T])
        np.testing.assert_allclose(found, expected, atol=close)
    assert np.abs(recording.joints.velocity).max() > 1
    acceleration = np.gradient(lift.joint_velocity, lift.step, axis=0)
    np.testing.assert_allclose(lift.joint_acceleration[1:-1], acceleration[1:-1], atol=0.1 * np.abs(acceleration).max())
    np.testing.assert_allclose(lift.angular_velocity_in_imu, 0, atol=1e-9)
    np.testing.assert_allclose(lift.up_in_imu, np.tile([0, 0, 1], (len(time), 1)), atol=1e-9)
    np.testing.assert_allclose(lift.acceleration_in_imu, np.tile([0, 0, 9.81], (len(time), 1)), atol=1e-9)


@pytest.mark.parametrize("velocities", [True, False])
def test_the_noise_of_velocities_matches_draws(a1, stance, velocities):
    exact = read(a1, stance, made_lift(a1, stance, velocities=velocities))
    misses, expected = [], []
    for seed in (1, 2, 3):
        lift = read(a1, stance, made_lift(a1, stance, noise=3e-4, velocities=velocities, seed=seed))
        time, offset = lift.step * np.arange(len(lift.joint_position)), lift.start - exact.start
        steady = (lift.start + time > LIFT + 2 * RISE) & (lift.start + time < LIFT + 0.56)
        assert abs(offset) < 0.01
        misses.append(lift.joint_velocity[steady])  # the joints are still there
        expected.append(np.diag(lift.velocity_noise)[steady])
    ratio = np.sqrt(np.mean(np.concatenate(misses) ** 2) / np.mean(np.concatenate(expected)))
    assert 0.75 < ratio < 1.33


def test_the_noise_of_the_imu_matches_draws(a1, stance):
    lifts = [read(a1, stance, made_lift(a1, stance, noise=3e-4, seed=seed)) for seed in range(8)]
    for drawn, covariances in (
        ([lift.angular_velocity_in_imu for lift in lifts], [lift.angular_velocity_noise for lift in lifts]),
        ([lift.acceleration_in_imu - [0, 0, 9.81] for lift in lifts], [lift.acceleration_noise for lift in lifts]),
    ):
        expected = np.mean([np.diag(noise).mean() for noise in covariances])
        assert 0.75 < np.sqrt(np.mean(np.concatenate(drawn) ** 2) / expected) < 1.33


# --- what cannot be read


def test_feet_that_never_rise_raise(a1, stance):
    with pytest.raises(RecordingError, match="the lifted feet did not leave the floor"):
        read(a1, stance, made_lift(a1, stance, height=0.001))


def test_feet_that_rise_too_briefly_raise(a1, stance):
    with pytest.raises(RecordingError, match=r"^two feet were up for only 0\.0"):
        read(a1, stance, made_lift(a1, stance, up_for=0.04))


def test_a_single_foot_in_the_air_raises(a1, stance):
    lifted = made_lift(a1, stance)
    position = np.array(lifted.joints.position)
    position[:, list(a1.legs["FR"].joints)] = stance.joint_position[list(a1.legs["FR"].joints)]
    joints = JointStream(lifted.joints.time, position, None)
    with pytest.raises(RecordingError, match="the lifted feet did not leave the floor"):
        read(a1, stance, replace(lifted, joints=joints))


@pytest.mark.parametrize("stream", ["joints", "imu"])
def test_missing_samples_raise(a1, stance, stream):
    lifted = made_lift(a1, stance)
    kept = np.arange(len(lifted.imu.time)) % 50 == 0
    kept |= lifted.imu.time < 0.4
    names = (
        ("time", "position", "velocity")
        if stream == "joints"
        else ("time", "angular_velocity_in_imu", "acceleration_in_imu")
    )
    whole = getattr(lifted, stream)
    thin = {stream: type(whole)(*(getattr(whole, name)[kept] for name in names))}
    with pytest.raises(RecordingError, match="samples are missing"):
        read(a1, stance, replace(lifted, **thin))


def test_a_simulated_lift_is_read_with_its_rotation(a1, ideal_motions):
    recording = ideal_motions.lift
    lift = read_lift(a1, LegChains(a1), recording, recording.trial.diagonal, ideal_motions.stance, np.zeros(3))
    assert isinstance(lift, LiftSamples)
    assert lift.pair == "FL_RR"
    # To and fro about the roll axis. What was up at rest turns the other way: its rate is up x angular velocity.
    assert np.abs(lift.angular_velocity_in_imu[:, 0]).max() > 0.3
    up, turning = lift.up_in_imu, lift.angular_velocity_in_imu
    np.testing.assert_allclose(np.linalg.norm(up, axis=1), 1, atol=1e-4)
    np.testing.assert_allclose(np.gradient(up, lift.step, axis=0)[1:-1], np.cross(up, turning)[1:-1], atol=0.12)
