"""Torque balance of motions with torques from Pinocchio and arbitrary contact forces."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tilting import SAMPLES, contact_jacobian, moving_robot

from equipoise.estimator.equations.torque_balance import TorqueSamples, sawtooth, torque_rows
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.unknowns import model_values
from equipoise.platform.platform import Trajectory
from equipoise.recording.recording import ImuStream, JointStream, Recording
from equipoise.robot.inertial import base_parameters, composite_parameters
from equipoise.robot.kinematics import inverse_kinematics
from equipoise.robot.stance import nominal_stance
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.effects import IDEAL
from equipoise.simulation.mujoco import MujocoPlatform
from equipoise.simulation.mujoco_model import build_simulated_robot


@pytest.fixture(scope="module", params=["a1", "skewed", "two_jointed"])
def robot(request):
    return request.getfixturevalue(request.param)


def nothing_wrong(robot):
    return model_values(robot)


def balance(robot, rows, torque, factors=None):
    """Return the (n, r) residual."""
    base = base_parameters(robot).to_pinocchio().toDynamicParameters()
    count = rows.links.shape[2] // 4
    links = np.concatenate([np.ones(count) if factors is None else factors, np.zeros(3 * count)])
    return rows.base @ base + rows.links @ links - np.einsum("nrj,nj->nr", rows.torque, torque)


@pytest.mark.parametrize("still", [True, False])
def test_the_balance_holds_for_any_contact_forces(robot, still):
    samples = moving_robot(robot, 1, still)
    rows = torque_rows(LegChains(robot), samples, nothing_wrong(robot))
    assert rows.base.shape == (SAMPLES, 6 if len(robot.joint_names) == 12 else 3, 10)
    left = balance(robot, rows, samples.joint_torque)
    assert np.abs(left).max() < 1e-8


def test_the_balance_fails_for_wrong_torques_masses_and_links(robot):
    samples = moving_robot(robot, 2)
    rows = torque_rows(LegChains(robot), samples, nothing_wrong(robot))
    count = len(robot.joint_names)
    for joint in range(count):
        wrong = samples.joint_torque.copy()
        wrong[:, joint] += 1.0
        assert np.abs(balance(robot, rows, wrong)).max() > 0.05
        assert np.abs(balance(robot, rows, samples.joint_torque, 1 + np.eye(count)[joint])).max() > 0.01
    # Legs of two joints report nothing about roll and yaw: of Ixx and Izz only the difference acts, in pitching.
    assert np.linalg.matrix_rank(rows.base.reshape(-1, 10)) == (10 if count == 12 else 9)


def test_contact_forces_are_eliminated(robot):
    samples = moving_robot(robot, 3)
    rows = torque_rows(LegChains(robot), samples, nothing_wrong(robot))
    for index in range(SAMPLES):
        q = robot.configuration(samples.joint_position[index])
        jacobian = contact_jacobian(robot, q)
        full = np.concatenate([rows.acceleration_rows[index], rows.torque[index]], axis=1)
        np.testing.assert_allclose(full @ jacobian.T, 0, atol=1e-12)
        np.testing.assert_allclose(full @ full.T, np.eye(len(full)), atol=1e-12)


@pytest.mark.parametrize("lifted", [None, "FL"])
def test_rows_of_legs_with_two_joints_do_not_depend_on_rounding(two_jointed, lifted):
    """On a level floor lateral forces at four feet, or at three, act in two ways on the robot, and almost in a third."""
    projections = []
    for spread in (0.0, 1e-12, 1e-7):
        samples = moving_robot(two_jointed, 12, lifted=lifted, spread=spread)
        rows = torque_rows(LegChains(two_jointed), samples, nothing_wrong(two_jointed))
        assert rows.torque.shape[1] == 4
        assert rows.force.max() < 1e-5
        full = np.concatenate([rows.acceleration_rows, rows.torque], axis=2)
        projections.append(np.swapaxes(full, 1, 2) @ full)
    for other in projections[1:]:
        np.testing.assert_allclose(other, projections[0], atol=1e-5)


def test_weak_forces_that_remain_are_stated(two_jointed):
    samples = moving_robot(two_jointed, 13, spread=1e-4)
    rows = torque_rows(LegChains(two_jointed), samples, nothing_wrong(two_jointed))
    full = np.concatenate([rows.acceleration_rows, rows.torque], axis=2)
    for index, position in enumerate(samples.joint_position):
        acting = full[index] @ contact_jacobian(two_jointed, two_jointed.configuration(position)).T
        assert np.abs(acting).max() > 1e-7
        np.testing.assert_allclose(np.linalg.norm(acting, axis=1), rows.force[index], rtol=1e-3, atol=1e-9)


@pytest.mark.parametrize("lifted", ["FL", "RR"])
def test_the_balance_holds_on_three_feet(robot, lifted):
    samples = moving_robot(robot, 11, lifted=lifted)
    rows = torque_rows(LegChains(robot), samples, nothing_wrong(robot))
    assert np.abs(balance(robot, rows, samples.joint_torque)).max() < 1e-8
    own = robot.legs[lifted].joints
    swung = samples.joint_torque.copy()
    swung[:, own] += 5.0
    assert np.abs(balance(robot, rows, swung)).max() < 1e-8
    for joint in set(range(len(robot.joint_names))) - set(own):
        assert np.abs(rows.torque[:, :, joint]).max() > 0.05


def test_samples_on_three_and_four_feet_can_be_joined(a1):
    both = TorqueSamples.joined([moving_robot(a1, 8), moving_robot(a1, 9, lifted="FR")])
    assert np.abs(balance(a1, torque_rows(LegChains(a1), both, nothing_wrong(a1)), both.joint_torque)).max() < 1e-8


def test_friction_and_armature_reduce_the_link_torque(robot):
    """tau_link = g tau - F_c tanh(v / v_0) - F_v v - A a, with the module's v_0 of 0.03 rad/s."""
    samples = moving_robot(robot, 4)
    coulomb_friction, viscous_friction, armature, gain = 0.4, 0.07, 0.015, 1.05
    lost = coulomb_friction * np.tanh(samples.joint_velocity / 0.03)
    lost += viscous_friction * samples.joint_velocity + armature * samples.joint_acceleration
    reported = (samples.joint_torque + lost) / gain
    rows = torque_rows(LegChains(robot), replace(samples, joint_torque=reported), nothing_wrong(robot))
    at_link = gain * reported - coulomb_friction * samples.friction_direction
    at_link -= viscous_friction * samples.joint_velocity + armature * samples.joint_acceleration
    assert np.abs(balance(robot, rows, at_link)).max() < 1e-8
    assert np.abs(balance(robot, rows, reported)).max() > 0.1


@pytest.mark.parametrize("name", ["a1", "skewed"])
def test_known_sensor_biases_are_subtracted(request, name):
    robot, generator = request.getfixturevalue(name), np.random.default_rng(5)
    biases = nothing_wrong(robot) | {
        "joint_offset": 0.01 * generator.standard_normal(len(robot.joint_names)),
        "imu_tilt": 0.02 * generator.standard_normal(3),
        "accelerometer_bias": 0.1 * generator.standard_normal(3),
    }
    tilt = Rotation.from_rotvec(biases["imu_tilt"]).as_matrix()
    true = moving_robot(robot, 6)
    seen = replace(
        true,
        joint_position=true.joint_position + biases["joint_offset"],
        angular_velocity_in_imu=true.angular_velocity_in_imu @ tilt,
        angular_acceleration_in_imu=true.angular_acceleration_in_imu @ tilt,
        acceleration_in_imu=true.acceleration_in_imu @ tilt + biases["accelerometer_bias"],
    )
    assert np.abs(balance(robot, torque_rows(LegChains(robot), seen, biases), seen.joint_torque)).max() < 1e-8
    assert (
        np.abs(balance(robot, torque_rows(LegChains(robot), seen, nothing_wrong(robot)), seen.joint_torque)).max() > 0.1
    )


def test_worn_feet_shift_the_contact_points(a1):
    samples = moving_robot(a1, 7)
    worn = torque_rows(LegChains(a1), samples, nothing_wrong(a1) | {"foot_radius": -0.5})
    assert np.abs(balance(a1, worn, samples.joint_torque)).max() > 0.05


# --- from recordings


def wave(time, amplitude, phases):
    return amplitude * np.sin(2 * np.pi * 1.5 * time[:, None] + phases)


def recorded(a1, duration=1.0, torque=True):
    time, phases = np.arange(round(duration * 500)) / 500, np.arange(12.0)
    position, velocity = wave(time, 0.1, phases), wave(time, 0.1 * 3 * np.pi, phases + np.pi / 2)
    joints = JointStream(time, position, velocity, wave(time, 5.0, phases) if torque else None)
    imu = ImuStream(time, 0.01 + wave(time, 0.5, phases[:3]), [0, 0, 9.81] + wave(time, 1.0, phases[:3]))
    return Recording(a1.joint_names, joints, imu)


def test_a_rest_is_averaged(a1):
    recording = recorded(a1)
    rest = TorqueSamples.of_rest(recording)
    np.testing.assert_allclose(rest.joint_torque, [recording.joints.torque.mean(axis=0)])
    np.testing.assert_allclose(rest.joint_position, [recording.joints.position.mean(axis=0)])
    np.testing.assert_allclose(rest.acceleration_in_imu, [recording.imu.acceleration_in_imu.mean(axis=0)])
    assert not any(
        np.any(getattr(rest, name))
        for name in ("joint_velocity", "joint_acceleration", "angular_velocity_in_imu", "angular_acceleration_in_imu")
    )


def test_a_motion_is_smoothed_with_its_derivatives(a1):
    samples = TorqueSamples.of_motion(recorded(a1), np.full(3, 0.01), 1.0)
    time, phases, omega = 0.05 + 0.09 * np.arange(len(samples.joint_position)), np.arange(12.0), 3 * np.pi
    assert 0.85 < time[-1] < 0.95  # the ends are left out
    expected = {
        "joint_position": wave(time, 0.1, phases),
        "joint_velocity": wave(time, 0.1 * omega, phases + np.pi / 2),
        "joint_acceleration": wave(time, -0.1 * omega**2, phases),
        "joint_torque": wave(time, 5.0, phases),
        "angular_velocity_in_imu": wave(time, 0.5, phases[:3]),
        "angular_acceleration_in_imu": wave(time, 0.5 * omega, phases[:3] + np.pi / 2),
        "acceleration_in_imu": [0, 0, 9.81] + wave(time, 1.0, phases[:3]),
    }
    for name, values in expected.items():
        np.testing.assert_allclose(getattr(samples, name), values, atol=1e-4 * np.abs(values).max(), err_msg=name)


def test_missing_torques_or_short_motions_give_no_samples(a1):
    assert TorqueSamples.of_rest(recorded(a1, torque=False)) is None
    assert TorqueSamples.of_motion(recorded(a1, torque=False), np.zeros(3), 1.0) is None
    assert TorqueSamples.of_motion(recorded(a1, duration=0.18), np.zeros(3), 1.0) is None
    assert TorqueSamples.of_motion(recorded(a1, duration=0.3), np.zeros(3), 1.0) is not None


def test_joined_samples_follow_each_other(a1):
    one, other = moving_robot(a1, 8), moving_robot(a1, 9)
    both = TorqueSamples.joined([one, other])
    np.testing.assert_array_equal(both.joint_torque, np.concatenate([one.joint_torque, other.joint_torque]))
    rows = torque_rows(LegChains(a1), both, nothing_wrong(a1))
    assert np.abs(balance(a1, rows, both.joint_torque)).max() < 1e-8


# --- of a simulated robot


def rocking(a1, period):
    """Return the recording of an ideal robot in MuJoCo that rotates its body over fixed feet."""
    stance = nominal_stance(a1)
    com = composite_parameters(a1, stance.joint_position).com
    time = np.arange(0, 1.0, period)
    angle = 0.12 * np.sin(2 * np.pi * 2 * time) * np.sin(np.pi * time)
    turned = [
        (stance.feet_in_base - com) @ Rotation.from_rotvec([x, 0.6 * x, 0.8 * x]).as_matrix() + com for x in angle
    ]
    position = np.array([inverse_kinematics(a1, feet, stance.joint_position) for feet in turned])
    simulated = build_simulated_robot(a1, stance, DrawnErrors.draw(IDEAL, 12, 0), None, 0.5e-3)
    platform = MujocoPlatform(a1, simulated, stance, control_period=period)
    return platform.play(Trajectory(position))


def test_the_residual_of_a_rocking_robot_is_the_sawtooth(a1):
    left, allowed = {}, {}
    for period in (0.5e-3, 2e-3):
        samples = TorqueSamples.of_motion(rocking(a1, period), np.zeros(3), 1.0)
        rows = torque_rows(LegChains(a1), samples, nothing_wrong(a1))
        left[period] = np.linalg.norm(balance(a1, rows, samples.joint_torque), axis=1)
        allowed[period] = sawtooth(rows.torque, samples, a1.gains(nominal_stance(a1).hip_height)[0])
    assert left[0.5e-3].max() < 0.01
    assert left[2e-3].max() > 0.1
    np.testing.assert_allclose(allowed[2e-3].max(), 4 * allowed[0.5e-3].max(), rtol=0.05)
    assert 0.5 < np.sqrt(np.mean(left[2e-3] ** 2) / np.mean(allowed[2e-3] ** 2)) < 1.5
