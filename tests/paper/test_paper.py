"""Estimates of the paper on synthetic signals."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from equipoise import nominal_stance
from equipoise.errors import RecordingError
from equipoise.experiments.tilt import SupportPlane
from equipoise.paper.equations import (
    commanded_plane,
    dominant_sinusoid,
    find_intersection,
    fit_axis,
    torque_about_com,
)
from equipoise.recording.recording import PHASE, Event, ImuStream, JointStream, Recording
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.kinematics import foot_jacobians
from equipoise.robot.statics import foot_forces, static_torques


@settings(max_examples=50, deadline=None)
@given(
    frequency=st.floats(0.9, 8),
    phase=st.floats(-3.1, 3.1),
    amplitude=st.floats(0.05, 5),
    mean=st.floats(-0.05, 0.05),
)
def test_the_frequency_error_of_a_sinusoid_is_far_below_a_bin(frequency, phase, amplitude, mean):
    time = np.arange(1500) * 2e-3
    found = dominant_sinusoid(time, mean + amplitude * np.sin(2 * np.pi * frequency * time + phase))
    assert found.frequency == pytest.approx(frequency, abs=1e-4)  # a bin is 0.33 Hz
    assert found.amplitude == pytest.approx(amplitude, rel=1e-3)
    assert np.cos(found.phase - phase) == pytest.approx(1, abs=1e-5)


def test_the_dominant_of_two_sinusoids_is_found():
    time = np.arange(2000) * 2e-3
    found = dominant_sinusoid(time, np.sin(2 * np.pi * 2 * time) + 0.3 * np.sin(2 * np.pi * 5 * time))
    assert found.frequency == pytest.approx(2, abs=0.01)


def test_the_analytic_derivative_of_a_sinusoid_equals_the_numeric_one():
    time = np.linspace(0, 1, 2001)
    sinusoid = dominant_sinusoid(np.arange(1000) * 2e-3, np.sin(2 * np.pi * 3 * np.arange(1000) * 2e-3 + 0.4))
    numeric = np.gradient(sinusoid.value(time), time)
    assert np.allclose(sinusoid.derivative(time)[1:-1], numeric[1:-1], atol=1e-3 * np.abs(numeric).max())


def test_a_base_that_does_not_oscillate_raises_an_error():
    with pytest.raises(RecordingError, match="the base did not oscillate"):
        dominant_sinusoid(np.arange(100) * 2e-3, np.ones(100))


def test_two_support_planes_meet_where_the_com_is():
    com = np.array([0.013, -0.004, -0.03])
    planes = []
    for normal in ([0.6, -0.8, 0.01], [0.6, 0.8, -0.02]):
        unit = np.array(normal) / np.linalg.norm(normal)
        along = np.cross(unit, [0, 0, 1.0])
        planes.append(SupportPlane(com + 0.7 * along, unit))
    assert find_intersection(planes, com[2]) == pytest.approx(com[:2], abs=1e-12)
    assert all(abs(plane.distance_to(com)) < 1e-12 for plane in planes)


def test_commanded_planes_point_forward_on_both_diagonals(a1):
    stance = nominal_stance(a1)
    for diagonal in ("FL_RR", "FR_RL"):
        plane = commanded_plane(stance, diagonal, 0.0)
        assert plane.normal[0] > 0
        assert plane.normal[2] == 0
        assert plane.distance_to(plane.point + [0.01, 0, 0]) > 0


def test_the_mean_of_two_planes_lies_halfway_between_them():
    one = SupportPlane(np.array([0.0, 0, 0]), np.array([1.0, 0, 0]))
    other = SupportPlane(np.array([0.01, 0, 0]), np.array([1.0, 0, 0]))
    assert one.towards(other, 0.5).distance_to(np.array([0.005, 3, 1])) == pytest.approx(0)


def synthetic_excitation(a1, inertia, damping, frequency=2.0, amplitude=0.6, rate=500, duration=4.0):
    """Return a recording with massless legs whose ground torque about the pitch axis is I d(omega)/dt + C omega."""
    stance = nominal_stance(a1)
    time = np.arange(int(duration * rate)) / rate
    omega = amplitude * np.sin(2 * np.pi * frequency * time + 0.3)
    alpha = amplitude * 2 * np.pi * frequency * np.cos(2 * np.pi * frequency * time + 0.3)
    wanted = inertia * alpha + damping * omega
    # Vertical forces that differ between front and rear give a torque about pitch.
    com = composite_parameters(a1, stance.joint_position).com
    arms = stance.feet_in_base - com
    still = foot_forces(a1, stance.joint_position, ("FL", "FR", "RL", "RR"))
    jacobians = foot_jacobians(a1, stance.joint_position)
    joints = np.array([leg.joints for leg in a1.legs.values()])
    torques = np.zeros((len(time), 12))
    share = -np.sign(arms[:, 0]) / np.abs(arms[:, 0]) / 4  # sum of -x f_z is 1
    for row, torque in enumerate(wanted):
        forces = still.copy()
        forces[:, 2] += share * torque
        torques[row, joints] = -np.einsum("lcj,lc->lj", jacobians, forces)
    gyro = np.zeros((len(time), 3))
    gyro[:, 1] = omega
    return stance, com, Recording(
        a1.joint_names,
        JointStream(time, np.tile(stance.joint_position, (len(time), 1)), None, torques),
        ImuStream(time, gyro, np.tile([0, 0, 9.81], (len(time), 1))),
        None,
        (Event(0.0, PHASE, {"name": "excitation"}),),
    )  # fmt: skip


def test_inertia_and_damping_are_recovered_from_synthetic_forces(a1):
    stance, com, recording = synthetic_excitation(a1, inertia=0.4, damping=0.7)
    fit = fit_axis(a1, recording, "pitch", com, stance.joint_position)
    assert fit.inertia == pytest.approx(0.4, rel=1e-3)
    assert fit.damping == pytest.approx(0.7, rel=0.02)
    assert fit.sinusoid.frequency == pytest.approx(2.0, abs=1e-3)


def test_a_standing_robot_has_no_torque_about_its_com(a1):
    stance, com, recording = synthetic_excitation(a1, inertia=0.0, damping=0.0)
    _, torque = torque_about_com(a1, recording, com, stance.joint_position)
    assert np.abs(torque).max() < 1e-9


def test_torques_of_massless_legs_are_the_static_ones_without_leg_gravity(a1):
    stance = nominal_stance(a1)
    difference = static_torques(a1, stance.joint_position, ("FL", "FR", "RL", "RR"))
    _, _, recording = synthetic_excitation(a1, 0, 0)
    leg_gravity = difference - recording.joints.torque[0]
    assert 0 < np.abs(leg_gravity).max() < 2.5  # Nm: about a kilogramme's leg at a tenth of a metre


def test_a_recording_without_torques_raises_an_error(a1):
    stance, com, recording = synthetic_excitation(a1, 0.1, 0)
    joints = JointStream(recording.joints.time, recording.joints.position)
    bare = Recording(recording.joint_names, joints, recording.imu, None, recording.events)
    with pytest.raises(RecordingError, match="no joint torques"):
        fit_axis(a1, bare, "pitch", com, stance.joint_position)
