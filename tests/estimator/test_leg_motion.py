"""Vectorised leg kinematics, compared with Pinocchio."""

import cases
import numpy as np
import pinocchio as pin
import pytest
from robots import load_text

from equipoise.estimator.measurements.leg_motion import LegChains, cross, cross_matrix
from equipoise.estimator.measurements.traced import Traced
from equipoise.robot.kinematics import foot_positions
from equipoise.robot.model import LEG_NAMES

CLOSE = {"rtol": 1e-9, "atol": 1e-11}


@pytest.fixture(scope="module", params=["a1", "skewed", "two_jointed"])
def robot(request):
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="module")
def states(robot):
    """Return joint positions, joint velocities and angular velocities of six samples."""
    generator = np.random.default_rng(1)
    joints = len(robot.joint_names)
    return tuple(size * generator.standard_normal((6, n)) for size, n in ((0.7, joints), (2.0, joints), (1.5, 3)))


def pinocchio_at(robot, position, velocity, turning):
    """Return Pinocchio's data at one sample; the base's origin rests."""
    model = robot.pinocchio
    data = model.createData()
    q, v = robot.configuration(position), np.concatenate([np.zeros(3), turning, velocity])
    pin.centerOfMass(model, data, q, v)
    pin.computeCentroidalMomentum(model, data, q, v)
    pin.forwardKinematics(model, data, q, v)
    pin.updateFramePlacements(model, data)
    return data


def links_of(legs, *states):
    """Return the (n, 4, k, 3) CoMs [m] of all links, their velocities [m/s] and angular momenta about them [kg m2/s]."""
    position, velocity, turning = (Traced(np.ascontiguousarray(part.T)) for part in states)
    posture = legs.traced_posture(position)
    moving = legs.traced_motion(posture, velocity, turning)
    return posture.com.value.T, moving.com_velocity.value.T, moving.spin.value.T


def test_links_match_pinocchio(robot, states):
    com, com_velocity, spin = links_of(LegChains(robot), *states)
    for sample, state in enumerate(zip(*states, strict=True)):
        data = pinocchio_at(robot, *state)
        for number, name in enumerate(LEG_NAMES):
            for link, joint in enumerate(robot.legs[name].joint_ids):
                place, body, speed = data.oMi[joint], robot.pinocchio.inertias[joint], data.v[joint]
                here = (sample, number, link)
                np.testing.assert_allclose(com[here], place.act(body.lever), **CLOSE)
                moving = place.rotation @ (speed.linear + np.cross(speed.angular, body.lever))
                np.testing.assert_allclose(com_velocity[here], moving, **CLOSE)
                np.testing.assert_allclose(spin[here], place.rotation @ body.inertia @ speed.angular, **CLOSE)


def test_feet_match_pinocchio(robot, states):
    motion = LegChains(robot).motion(*states)
    for sample, state in enumerate(zip(*states, strict=True)):
        data = pinocchio_at(robot, *state)
        for number, name in enumerate(LEG_NAMES):
            frame = robot.legs[name].foot_frame_id
            speed = pin.getFrameVelocity(robot.pinocchio, data, frame, pin.LOCAL_WORLD_ALIGNED)
            np.testing.assert_allclose(motion.foot[sample, number], data.oMf[frame].translation, **CLOSE)
            np.testing.assert_allclose(motion.foot_velocity[sample, number], speed.linear, **CLOSE)
            np.testing.assert_allclose(motion.foot_angular_velocity[sample, number], speed.angular, **CLOSE)


def test_momenta_of_base_and_links_add_up(robot, states):
    legs = LegChains(robot)
    com, com_velocity, spin = links_of(legs, *states)
    base = robot.pinocchio.inertias[1]
    for sample, state in enumerate(zip(*states, strict=True)):
        data = pinocchio_at(robot, *state)
        turning = state[2]
        base_linear = base.mass * np.cross(turning, base.lever)
        momenta = legs.mass[..., None] * com_velocity[sample]
        np.testing.assert_allclose(base_linear + momenta.sum(axis=(0, 1)), data.hg.linear, **CLOSE)
        about_com = base.inertia @ turning + np.cross(base.lever - data.com[0], base_linear)
        about_com += (spin[sample] + np.cross(com[sample] - data.com[0], momenta)).sum(axis=(0, 1))
        np.testing.assert_allclose(about_com, data.hg.angular, **CLOSE)


def test_velocities_match_differences(robot, states):
    position, velocity, _ = states
    legs, none, dt = LegChains(robot), np.zeros((len(position), 3)), 1e-6
    ahead, behind = (legs.motion(position + s * dt * velocity, velocity, none) for s in (1, -1))
    (com_ahead, *_), (com_behind, *_) = (links_of(legs, position + s * dt * velocity, velocity, none) for s in (1, -1))
    here, (_, com_velocity, _) = legs.motion(position, velocity, none), links_of(legs, position, velocity, none)
    np.testing.assert_allclose(com_velocity, (com_ahead - com_behind) / (2 * dt), atol=1e-7)
    np.testing.assert_allclose(here.foot_velocity, (ahead.foot - behind.foot) / (2 * dt), atol=1e-7)


def test_feet_match_the_kinematics(robot, states):
    feet = LegChains(robot).feet(states[0])
    np.testing.assert_allclose(feet, [foot_positions(robot, position) for position in states[0]], **CLOSE)


def test_masses_and_joints_match_the_model(robot):
    legs = LegChains(robot)
    assert legs.links == legs.joints.size == len(robot.joint_names)
    assert sorted(legs.joints.ravel()) == list(range(len(robot.joint_names)))
    assert legs.mass.sum() + robot.pinocchio.inertias[1].mass == pytest.approx(robot.mass)
    for number, name in enumerate(LEG_NAMES):
        assert [robot.joint_names[joint] for joint in legs.joints[number]] == list(robot.legs[name].joint_names)
        assert legs.foot_radius[number] == robot.legs[name].foot_radius


@pytest.mark.parametrize("offset", ["0 0 0", "0 1e-18 0", "0.05 0 0", "0 1e-4 0", "0 0 1e-4"])
def test_axes_exist_if_the_next_joint_lies_on_the_axis(tmp_path, offset):
    robot = load_text(tmp_path, cases.urdf(offset))
    legs = LegChains(robot)
    np.testing.assert_allclose(
        legs.axes @ legs.axes.swapaxes(-1, -2), np.broadcast_to(np.eye(3), (4, 3, 3, 3)), atol=1e-12
    )
    np.testing.assert_array_equal(legs.axes[:, 0, :, 2], np.tile([1.0, 0, 0], (4, 1)))
    _, y, z = map(float, offset.split())
    np.testing.assert_allclose(legs.reach[:, 0], np.hypot(y, z), rtol=1e-9)
    if legs.reach[0, 0] < 1e-6:  # down to the knee then
        np.testing.assert_allclose(legs.axes[:, 0, :, 0], np.tile([0.0, 0, -1], (4, 1)), atol=1e-12)


def test_a_link_may_have_zero_length(tmp_path):
    locked = cases.with_limits(cases.urdf("0 0 0"), "calf", 'lower="-1" upper="-1"')
    legs = LegChains(load_text(tmp_path, locked))  # abduction and hip pitch, whose axes meet
    assert np.isfinite(legs.axes).all()
    np.testing.assert_allclose(legs.reach[:, 0], 0, atol=1e-12)


def test_the_cross_product_matches_numpy():
    a, b = np.random.default_rng(2).standard_normal((2, 4, 5, 3))
    np.testing.assert_allclose(cross(a, b), np.cross(a, b), atol=1e-15)
    np.testing.assert_allclose((cross_matrix(a) @ b[..., None])[..., 0], np.cross(a, b), atol=1e-15)
    np.testing.assert_allclose(cross(a, b[0, 0]), np.cross(a, b[0, 0]), atol=1e-15)
