"""Tilt equation, compared with Pinocchio's momenta and on exact motions."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation
from tilting import GRAVITY, Compliance, Swing, lift_samples, pendulum, rolling_feet, sides, wandering

from equipoise import load_robot, nominal_stance
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.measurements.support_planes import support_planes
from equipoise.estimator.measurements.tilt_invariant import TiltInvariant
from equipoise.estimator.motions import read_motions
from equipoise.estimator.unknowns import model_values
from equipoise.experiments.posture import feet_in_posture
from equipoise.robot.description import RobotDescription
from equipoise.robot.inertial import base_parameters, composite_parameters
from equipoise.robot.kinematics import inverse_kinematics
from equipoise.robot.posture import BodyPosture

STEP = 0.01
DIAGONALS = ("FL_RR", "FR_RL")


@pytest.fixture(scope="module", params=["a1", "skewed", "two_jointed"])
def robot(request):
    return request.getfixturevalue(request.param)


def parameters(robot):
    """Return the tilt equation's inertial parameters of the model."""
    vector, links = base_parameters(robot).to_pinocchio().toDynamicParameters(), len(robot.joint_names)
    return np.concatenate([vector, np.ones(links), np.zeros(3 * links)])


def equation_of(robot, *lifts):
    return TiltInvariant(robot, LegChains(robot), lifts)


def nothing_wrong(robot):
    return model_values(robot)


def rows_of(robot, *lifts, biases=None):
    return equation_of(robot, *lifts).rows(nothing_wrong(robot) if biases is None else biases)[0]


def random_state(robot, seed):
    """Return joint positions and velocities, angular velocity, upward direction and specific force of the base."""
    generator, joints = np.random.default_rng(seed), len(robot.joint_names)
    position = np.array(nominal_stance(robot).joint_position) + 0.2 * generator.standard_normal(joints)
    up = np.array([0, 0, 1]) + 0.2 * generator.standard_normal(3)
    velocity, turning = 2 * generator.standard_normal(joints), generator.standard_normal(3)
    up /= np.linalg.norm(up)
    return position, velocity, turning, up, GRAVITY * up + 2 * generator.standard_normal(3)


def frozen_lift(robot, diagonal, state):
    """Return a lift of three equal samples: y is the momentum at first, minus one step of the rate at the second."""
    position, velocity, turning, up, force = state
    mounting, arm = np.array(robot.imu_in_base.rotation), np.array(robot.imu_in_base.translation)
    turning_rate = np.array([8.0, -5.0, 3.0])
    at_imu = force + np.cross(turning_rate, arm) + np.cross(turning, np.cross(turning, arm))
    columns = position, velocity, turning, up @ mounting, at_imu @ mounting, turning_rate @ mounting
    position, velocity, turning, up_in_imu, acceleration, turning_rate = (np.tile(part, (3, 1)) for part in columns)
    return lift_samples(
        robot, diagonal, position, velocity, turning, up_in_imu=up_in_imu, acceleration_in_imu=acceleration,
        angular_acceleration_in_imu=turning_rate, step=STEP,
    )  # fmt: skip


class Moving:
    """Momentum and its rate from Pinocchio, of a robot whose stance feet roll on the floor as spheres."""

    def __init__(self, robot, diagonal, state, normal=None):
        position, velocity, turning, self.up, self.force = state
        normal = self.up if normal is None else normal
        self.contacts, self.speeds, base = rolling_feet(robot, diagonal, position, velocity, turning, normal)
        self.of_point = self.speeds[1] - base
        model = robot.pinocchio
        self.data, self.mass = model.createData(), pin.computeTotalMass(model)
        q, v = robot.configuration(position), np.concatenate([np.zeros(3), turning, velocity])
        pin.centerOfMass(model, self.data, q, v)
        pin.computeCentroidalMomentum(model, self.data, q, v)
        self.left, self.point = self.direction(0), self.contacts[1]

    def direction(self, time):
        a, b = (place + time * speed for place, speed in zip(self.contacts, self.speeds, strict=True))
        return (a - b) / np.linalg.norm(a - b)

    @property
    def about_point(self):
        return self.data.hg.angular + np.cross(self.data.com[0] - self.point, self.data.hg.linear)

    @property
    def momentum(self):
        return self.left @ self.about_point

    @property
    def rate(self):
        """The right side of the tilt equation."""
        rate = -self.left @ np.cross(self.data.com[0] - self.point, self.mass * self.force)
        rate -= self.left @ np.cross(self.of_point, self.data.hg.linear)
        return rate + (self.direction(1e-6) - self.direction(-1e-6)) / 2e-6 @ self.about_point


def with_other_links(robot, generator):
    """Return a robot with another base, other leg masses and CoMs, and its parameters."""
    factors = generator.uniform(0.5, 1.5, len(robot.joint_names))
    base = pin.Inertia(generator.uniform(3, 9), 0.1 * generator.standard_normal(3), pin.Inertia.Random().inertia)
    other = robot.with_base(base)
    joints = [joint for leg in robot.legs.values() for joint in leg.joint_ids]
    moments = 3e-3 * generator.standard_normal((len(joints), 3))
    for joint, factor, moment in zip(joints, factors, moments, strict=True):
        link = robot.pinocchio.inertias[joint]
        apart = [point_mass(link.lever + sign * moment / 2) for sign in (1, -1)]
        vector = factor * link.toDynamicParameters() + apart[0] - apart[1]
        other.pinocchio.inertias[joint] = pin.Inertia.FromDynamicParameters(vector)
    return other, np.concatenate([base.toDynamicParameters(), factors, moments.ravel()])


def point_mass(place):
    """Return a point mass of 1 kg: the difference of two is a first moment."""
    return pin.Inertia(1.0, place, np.zeros((3, 3))).toDynamicParameters()


@pytest.mark.parametrize("diagonal", DIAGONALS)
def test_columns_match_pinocchio(robot, diagonal):
    pin.seed(5)
    generator = np.random.default_rng(5)
    state = random_state(robot, 5)
    rows = rows_of(robot, frozen_lift(robot, diagonal, state))
    momentum, rate = rows[0], (rows[0] - rows[1]) / STEP
    for _ in range(rows.shape[1] + 3):
        other, vector = with_other_links(robot, generator)
        moving = Moving(other, diagonal, state)
        assert momentum @ vector == pytest.approx(moving.momentum, rel=1e-9, abs=1e-11)
        assert rate @ vector == pytest.approx(moving.rate, rel=1e-7, abs=1e-7)


def test_a_sloping_floor_and_worn_feet_change_where_feet_touch(robot):
    state, slope = random_state(robot, 6), np.array([0.02, -0.03])
    biases = nothing_wrong(robot) | {"floor_slope": slope, "foot_radius": np.array([-0.1])}
    rows = rows_of(robot, frozen_lift(robot, "FL_RR", state), biases=biases)
    normal = 0.9 * (state[3] + [*slope, 0]) / np.linalg.norm(state[3] + [*slope, 0])
    moving = Moving(robot, "FL_RR", state, normal)
    assert rows[0] @ parameters(robot) == pytest.approx(moving.momentum, rel=1e-9)
    assert (rows[0] - rows[1]) / STEP @ parameters(robot) == pytest.approx(moving.rate, rel=1e-7)


@pytest.mark.parametrize("diagonal", DIAGONALS)
def test_the_inertia_about_the_line_is_the_composites_with_its_parallel_axis(robot, diagonal):
    state = random_state(robot, 7)
    lift = frozen_lift(robot, diagonal, state)
    _, inertia = equation_of(robot, lift).rows(nothing_wrong(robot))
    moving, body = Moving(robot, diagonal, state), composite_parameters(robot, state[0])
    arm = np.cross(moving.left, body.com - moving.point)
    expected = moving.left @ body.inertia @ moving.left + body.mass * arm @ arm
    assert inertia.shape == (1, 10 + 4 * len(robot.joint_names))
    assert inertia[0] @ parameters(robot) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("diagonal", DIAGONALS)
def test_sensor_levers_match_pinocchio(robot, diagonal):
    position, velocity, turning, up, force = state = random_state(robot, 8)
    lift = frozen_lift(robot, diagonal, state)
    _, levers = equation_of(robot, lift).evaluate(nothing_wrong(robot), parameters(robot))
    moving = Moving(robot, diagonal, state)
    expected = [moving.mass * up @ (moving.data.com[0] - moving.point)]
    for axis in np.array(robot.imu_in_base.rotation).T:
        expected.append(Moving(robot, diagonal, (position, 0 * velocity, axis, up, force)).momentum)
    for unit in np.eye(len(robot.joint_names)):
        expected.append(Moving(robot, diagonal, (position, unit, 0 * turning, up, force)).momentum)
    assert levers.shape == (5 + len(robot.joint_names), 1)
    np.testing.assert_allclose(levers[1:, 0], expected, rtol=1e-9, atol=1e-12)


def test_the_com_height_is_the_lever_of_the_specific_force(a1):
    _, velocity, turning, _, force = random_state(a1, 9)
    state = nominal_stance(a1).joint_position, 0 * velocity, 0 * turning, np.array([0.0, 0.0, 1.0]), force
    lift = frozen_lift(a1, "FL_RR", state)
    equation, moving = equation_of(a1, lift), Moving(a1, "FL_RR", state)
    across = np.cross(moving.left, state[3])
    pushed = frozen_lift(a1, "FL_RR", (*state[:4], force + 0.1 * across))
    (exact, levers), (y, _) = (
        one.evaluate(nothing_wrong(a1), parameters(a1)) for one in (equation, equation_of(a1, pushed))
    )
    assert (y - exact)[-1] - (y - exact)[0] == pytest.approx(0.1 * 2 * STEP * levers[1, 0], rel=1e-3)


# --- motions that obey the laws of mechanics


def toppling(robot, diagonal="FL_RR", posture=None, **kind):
    """Return a pendulum in a posture, with its CoM 6 mm from the line."""
    stance = nominal_stance(robot)
    com = composite_parameters(robot, stance.joint_position).com
    posture = posture or BodyPosture()
    feet = feet_in_posture(stance, com, posture, diagonal, 0.006)
    position = inverse_kinematics(robot, feet, stance.joint_position, tolerance=1e-4)
    return pendulum(robot, position, diagonal, posture.rotation[2], **kind)


def residual(robot, lift, shift=(0.0, 0.0, 0.0), biases=None):
    """Return the variation of y, divided by the moment of inertia about the line [rad/s].

    Args:
        shift: of the whole robot's CoM from the model's [m].
    """
    rows, inertia = equation_of(robot, lift).rows(biases or nothing_wrong(robot))
    vector = parameters(robot)
    vector[1:4] += robot.mass * np.asarray(shift)
    return wandering(rows @ vector) / float(inertia[0] @ parameters(robot))


POSTURES = {
    "nominal": BodyPosture(),
    "rolled": BodyPosture(roll=0.2, crouch=0.1),
    "pitched and yawed": BodyPosture(pitch=-0.2, yaw=0.2, crouch=0.1),
}


@pytest.mark.parametrize("diagonal", DIAGONALS)
@pytest.mark.parametrize("posture", POSTURES.values(), ids=POSTURES)
@pytest.mark.parametrize("name", ["a1", "skewed"])
def test_y_is_constant_on_rolling_feet_only_for_the_true_com(request, name, posture, diagonal):
    robot = request.getfixturevalue(name)
    lift = toppling(robot, diagonal, posture)
    assert np.linalg.norm(lift.up_in_imu[-1] - lift.up_in_imu[0]) > 0.02  # it did topple
    exact = residual(robot, lift)
    assert exact < 1e-6
    left, right = (nominal_stance(robot).feet_in_base[foot] for foot in sides(diagonal))
    normal = np.cross(left - right, posture.rotation[2])
    assert residual(robot, lift, 2e-3 * normal / np.linalg.norm(normal)) > 5e-3


def test_y_is_constant_only_for_the_true_foot_radius(a1):
    without = toppling(a1, radius=0.0)
    assert residual(a1, without, biases=nothing_wrong(a1) | {"foot_radius": np.array([-1.0])}) < 1e-6
    assert residual(a1, without) > 1e-3


def test_y_is_constant_only_for_the_true_rolling_resistance(a1):
    resisted = toppling(a1, resistance=1e-3)
    assert residual(a1, resisted, biases=nothing_wrong(a1) | {"rolling_resistance": np.array([1e-3])}) < 1e-5
    assert residual(a1, resisted) > 1e-3


def test_y_is_constant_for_legs_of_two_joints(two_jointed):
    assert residual(two_jointed, toppling(two_jointed)) < 1e-6


def with_other_legs(robot, factor):
    """Return parameters with heavier leg links."""
    vector = parameters(robot)
    vector[10 : 10 + len(robot.joint_names)] = factor
    return vector


@pytest.mark.parametrize("diagonal", DIAGONALS)
@pytest.mark.parametrize("name", ["a1", "skewed"])
def test_y_is_constant_with_swinging_legs_only_for_the_true_masses(request, name, diagonal):
    robot = request.getfixturevalue(name)
    lift = toppling(robot, diagonal, POSTURES["rolled"], swing=Swing(0.3))
    assert np.abs(lift.joint_velocity).max() > 4
    assert residual(robot, lift) < 1e-5
    rows, inertia = equation_of(robot, lift).rows(nothing_wrong(robot))
    assert wandering(rows @ with_other_legs(robot, 1.1)) / float(inertia[0] @ parameters(robot)) > 2e-3


@pytest.mark.parametrize("way", ["across", "up"])
def test_y_is_constant_with_unmeasured_compliance(a1, way):
    stance, pace = nominal_stance(a1), 2 * np.pi * 15.0
    left, right = (stance.feet_in_base[foot] for foot in sides("FL_RR"))
    line = (left - right) / np.linalg.norm(left - right)
    direction = {"across": np.cross(line, [0, 0, 1]), "up": np.array([0.0, 0.0, 1.0])}[way]
    lift = toppling(a1, compliance=Compliance(tuple(3e-4 * direction), 15.0))
    _, inertia = equation_of(a1, lift).rows(nothing_wrong(a1))
    body = composite_parameters(a1, lift.joint_position[0])
    arm = body.com - LegChains(a1).feet(lift.joint_position[:1])[0, lift.stance_feet[1]]
    momentum = abs(line @ np.cross(arm, body.mass * 3e-4 * pace * direction)) / np.sqrt(2)
    missed = momentum / float(inertia[0] @ parameters(a1))
    assert np.abs(lift.acceleration_in_imu - toppling(a1).acceleration_in_imu).max() > 0.2  # it does excitation
    assert residual(a1, lift) < 0.01 * missed


def with_far_imu():
    return load_robot("unitree_a1", RobotDescription(imu_position=(0.2, -0.1, 0.15)))


def test_the_position_of_the_imu_is_corrected_for(a1):
    far = with_far_imu()
    np.testing.assert_array_equal(far.imu_in_base.rotation, a1.imu_in_base.rotation)
    lift = toppling(far, rate=0.6)
    assert residual(far, lift) < 1e-6
    assert residual(a1, lift) > 5e-3  # what thinks that it is elsewhere


def test_a_tilted_posture_determines_the_com_height(a1):
    level, rolled = (toppling(a1, posture=POSTURES[name]) for name in ("nominal", "rolled"))
    up = [0, 0, 5e-3]
    assert residual(a1, rolled, up) > 5 * residual(a1, level, up)


def test_a_simulated_lift_with_the_body_turning_agrees_with_the_truth_and_not_with_another_com(a1, ideal_motions):
    evidence = read_motions(a1, ideal_motions.stance, [ideal_motions.lift])
    lift = evidence[0].lift
    assert np.abs(lift.joint_velocity).max() > 0.5  # the legs are moving
    exact = residual(a1, lift)
    assert exact < 6e-3  # [rad/s]: contacts that give
    assert residual(a1, lift, [2e-3, 0, 0]) > 3 * exact
    assert residual(a1, lift, [-2e-3, 0, 0]) > 3 * exact


# --- sensors that are off


def seen_by(robot, lift, biases):
    """Return the lift as recorded by sensors with these biases, without clock offset."""
    tilt = Rotation.from_rotvec(biases["imu_tilt"]).as_matrix()
    error = np.diag(biases["gyro_gain"])
    error[~np.eye(3, dtype=bool)] = biases["gyro_misalignment"]
    turning = tilt @ np.linalg.inv(np.eye(3) - error).T  # the true velocity is 1 - E times what is read
    return replace(
        lift,
        joint_position=lift.joint_position + biases["joint_offset"],
        angular_velocity_in_imu=lift.angular_velocity_in_imu @ turning,
        angular_acceleration_in_imu=lift.angular_acceleration_in_imu @ turning,
        acceleration_in_imu=lift.acceleration_in_imu @ tilt + biases["accelerometer_bias"],
        up_in_imu=lift.up_in_imu @ tilt,
    )


@pytest.mark.parametrize("name", ["a1", "skewed", "far"])
def test_known_sensor_biases_are_subtracted(request, name):
    robot, generator = with_far_imu() if name == "far" else request.getfixturevalue(name), np.random.default_rng(4)
    biases = nothing_wrong(robot) | {
        "joint_offset": 5e-3 * generator.standard_normal(len(robot.joint_names)),
        "imu_tilt": 0.02 * generator.standard_normal(3),
        "accelerometer_bias": 0.1 * generator.standard_normal(3),
        "gyro_gain": 0.02 * generator.standard_normal(3),
        "gyro_misalignment": 0.02 * generator.standard_normal(6),
    }
    lift = toppling(robot, posture=POSTURES["rolled"], rate=0.6)
    biased = seen_by(robot, lift, biases)
    expected, found = rows_of(robot, lift), rows_of(robot, biased, biases=biases)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    assert np.abs(rows_of(robot, biased) - expected).max() > 1e-3


@pytest.mark.parametrize("late", [2e-3, -2e-3])
def test_a_known_clock_offset_is_corrected(a1, late):
    lift = toppling(a1, late=late, swing=Swing(0.3))

    def miss(offset):
        return residual(a1, lift, biases=nothing_wrong(a1) | {"clock_offset": np.array([offset])})

    assert miss(0.0) > 2e-3
    assert miss(late) < 0.05 * miss(0.0)


def test_trials_are_evaluated_separately(a1):
    lifts = [toppling(a1, diagonal, step=0.01) for diagonal in DIAGONALS]
    equation = equation_of(a1, *lifts)
    rows, inertia = equation.rows(nothing_wrong(a1))
    for number, (trial, lift) in enumerate(zip(equation.trials, lifts, strict=True)):
        alone, alone_inertia = equation_of(a1, lift).rows(nothing_wrong(a1))
        np.testing.assert_allclose(rows[trial], alone, atol=1e-14)
        np.testing.assert_allclose(inertia[number], alone_inertia[0], atol=1e-14)


# --- one lift alone: how far the CoM is from where it is thought to be


@pytest.mark.parametrize("diagonal", DIAGONALS)
@pytest.mark.parametrize("distance", [-0.012, 0.0, 0.004])
def test_a_support_plane_estimates_the_com_error(a1, diagonal, distance):
    stance = nominal_stance(a1)
    left, right = (stance.feet_in_base[foot] for foot in sides(diagonal))
    normal = np.cross(left - right, [0, 0, 1])
    normal /= np.linalg.norm(normal)
    base = a1.pinocchio.inertias[1]
    moved = base.toDynamicParameters()
    moved[1:4] += a1.mass * distance * normal
    lever = moved[1:4] / base.mass
    truth = a1.with_base(pin.Inertia(base.mass, lever, base.inertia))
    lift = pendulum(truth, np.array(stance.joint_position), diagonal, np.array([0.0, 0, 1]))
    com = composite_parameters(a1, stance.joint_position).com
    (found,) = support_planes(a1, com, [lift])
    assert found.normal == pytest.approx(normal, abs=1e-3)
    assert found.normal[0] > 0
    assert -found.distance_to(com) == pytest.approx(distance, abs=0.05 * abs(distance) + 1e-4)


def test_results_kept_from_the_last_derivatives_belong_to_their_values(a1):
    """Results after derivatives at the same values, by other parameters, and at other values equal those of a new equation."""
    lift = frozen_lift(a1, "FL_RR", random_state(a1, 5))
    model, inertial, kept = nothing_wrong(a1), parameters(a1), equation_of(a1, lift)
    moved = {**model, "imu_tilt": np.array([0.1, 0.0, 0.0])}
    kept.linearise(model, inertial, ("imu_tilt",))
    for values, of_bodies in ((model, inertial), (moved, inertial), (model, 1.1 * inertial)):
        new = equation_of(a1, lift)
        for result, expected in zip(kept.evaluate(values, of_bodies), new.evaluate(values, of_bodies), strict=True):
            np.testing.assert_array_equal(result, expected)
        np.testing.assert_array_equal(kept.levers(values, of_bodies), new.levers(values, of_bodies))
        assert set(kept.linearise(values, of_bodies, ("clock_offset",))[2]) == {"inertial", "clock_offset"}
