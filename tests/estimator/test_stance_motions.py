"""Stance motions: predicted ones with known answers, and one of a simulated robot."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from equipoise import nominal_stance
from equipoise.bayesian.predict import Predictor
from equipoise.estimator.equations.equation import RunContext
from equipoise.estimator.equations.stance_motion import RestReading, StanceMotions, read_move
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.parameters import Unknowns
from equipoise.estimator.unknowns import Priors, model_values
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.kinematics import foot_positions
from equipoise.robot.posture import BodyPosture

HOME = BodyPosture(crouch=0.05)
POSTURES = (
    BodyPosture(roll=0.2, crouch=0.1),
    BodyPosture(pitch=-0.2, yaw=0.2, crouch=0.1, aside=0.1),
    BodyPosture(crouch=0.3, ahead=0.1),
)


@pytest.fixture(scope="module", params=["a1", "skewed"])
def robot(request):
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="module")
def moves(robot):
    stance = nominal_stance(robot)
    predictor = Predictor(robot, stance, composite_parameters(robot, stance.joint_position).com)
    return [predictor.move(HOME, posture) for posture in POSTURES]


def rows_of(robot, moves):
    return StanceMotions(Unknowns(robot, nominal_stance(robot), Priors()), [*enumerate(moves)])


def residuals(rows, values):
    """(moves, 4, 3) displacements of the feet and (moves, 2, 4) heights of their centres [m]."""
    found = rows.residuals(values)
    return found[:, :3].transpose(0, 2, 1), found[:, 3:]


def test_stance_feet_do_not_move_and_stand_level(robot, moves):
    displacements, heights = residuals(rows_of(robot, moves), model_values(robot))
    assert displacements.shape == (3, 4, 3)
    assert heights.shape == (3, 2, 4)
    assert np.abs(displacements).max() < 1e-6
    assert np.abs(heights).max() < 1e-6


def test_a_joint_offset_moves_feet_as_the_kinematics_predict(robot, moves):
    """Compare with Pinocchio's feet, rotated back by the postures."""
    rows, size = rows_of(robot, moves), 5e-3
    for joint in range(12):
        zero = size * np.eye(12)[joint]
        biases = model_values(robot) | {"joint_offset": zero}
        found, heights = residuals(rows, biases)
        for number, (move, posture) in enumerate(zip(moves, POSTURES, strict=True)):
            before, after = (foot_positions(robot, rest.joint_position - zero) for rest in (move.before, move.after))
            moved = after @ posture.rotation.T @ HOME.rotation - before
            np.testing.assert_allclose(found[number], moved - moved.mean(axis=0), atol=1e-9)
            for row, feet, rotation in ((0, before, HOME.rotation), (1, after, posture.rotation)):
                above = feet @ rotation[2]
                np.testing.assert_allclose(heights[number, row], above - above.mean(), atol=1e-9)
        half = model_values(robot) | {"joint_offset": zero / 2}
        for whole, part in zip((found, heights), residuals(rows, half), strict=True):
            np.testing.assert_allclose(part, whole / 2, atol=0.02 * np.abs(whole).max() + 1e-6)
        assert np.abs(found).max() > 5e-5  # of the millimetre that a foot moves, most is common to both postures


def seen_by(move, biases):
    """Return the motion as recorded by sensors with these biases."""
    tilt = Rotation.from_rotvec(biases["imu_tilt"]).as_matrix()
    before, after = (
        RestReading(
            rest.joint_position + biases["joint_offset"],
            tilt.T @ rest.acceleration_in_imu + biases["accelerometer_bias"],
            rest.load,
            rest.joint_torque,
        )
        for rest in (move.before, move.after)
    )
    return replace(move, before=before, after=after, rotation_to_before=tilt.T @ move.rotation_to_before @ tilt)


@pytest.mark.parametrize("bias", ["joint_offset", "imu_tilt", "accelerometer_bias"])
def test_known_sensor_biases_are_subtracted(robot, moves, bias):
    value = {"joint_offset": np.linspace(-8e-3, 6e-3, 12), "imu_tilt": np.array([0.02, -0.01, 0.03])}
    biases = model_values(robot) | {bias: value.get(bias, np.array([0.05, 0.08, -0.03]))}
    rows = rows_of(robot, [seen_by(move, biases) for move in moves])
    for found in residuals(rows, biases):
        assert np.abs(found).max() < 1e-6
    displacements, heights = residuals(rows, model_values(robot))
    assert np.abs(heights).max() > 1e-4
    if bias != "accelerometer_bias":
        assert np.abs(displacements).max() > 1e-4


def test_foot_rolling_is_subtracted(robot, moves):
    rolled = 1e-3 * np.arange(12.0).reshape(4, 3)
    biases = model_values(robot) | {"foot_radius": np.array([0.1])}
    found, _ = residuals(rows_of(robot, [replace(moves[0], rolled=rolled)]), biases)
    np.testing.assert_allclose(found[0], -1.1 * (rolled - rolled.mean(axis=0)), atol=1e-6)


def test_the_feet_of_a_simulated_move_stay_after_rolling_correction(a1, ideal_motions):
    recording = ideal_motions.move
    moving = recording.phase("move", until="rest")
    run = RunContext(a1, nominal_stance(a1), LegChains(a1), np.zeros(3), 0.0, 0.0)
    move = read_move(run, recording.phase("before"), moving, recording.phase("rest"))
    displacements, heights = residuals(rows_of(a1, [move]), model_values(a1))
    sliding, _ = residuals(rows_of(a1, [replace(move, rolled=np.zeros((4, 3)))]), model_values(a1))
    stay, slide = np.abs(displacements).max(), np.abs(sliding).max()
    assert stay < 2.5e-4
    assert slide > 4 * stay
    assert np.abs(heights).max() < 2e-4
    # Relative to the nominal stance, and about as commanded: position control sags.
    turned = Rotation.from_matrix(move.rotation_to_before)
    assert (turned.inv() * Rotation.from_matrix(ideal_motions.posture.rotation)).magnitude() < 0.02
    assert turned.magnitude() > 0.2


def test_a_rest_is_its_means(a1, ideal_motions):
    still = ideal_motions.move.phase("rest")
    rest = RestReading.of(a1, still)
    np.testing.assert_allclose(rest.joint_position, still.joints.position.mean(axis=0))
    np.testing.assert_allclose(rest.acceleration_in_imu, still.imu.acceleration_in_imu.mean(axis=0))


def test_feet_sink_under_their_load(robot, moves):
    """Compare with Pinocchio's feet lowered by compliance times load, which no encoder measures."""
    foot_compliance = 4e-5
    for move in moves:
        for rest in (move.before, move.after):
            assert rest.load.sum() == pytest.approx(robot.mass * 9.81, rel=0.01)
            assert rest.load.min() > 0
    biases = model_values(robot) | {"foot_compliance": np.array([foot_compliance])}
    displacements, heights = residuals(rows_of(robot, moves), biases)
    for number, (move, posture) in enumerate(zip(moves, POSTURES, strict=True)):
        for row, (rest, rotation) in enumerate(((move.before, HOME.rotation), (move.after, posture.rotation))):
            sunk = foot_positions(robot, rest.joint_position) @ rotation[2] + foot_compliance * rest.load
            np.testing.assert_allclose(heights[number, row], sunk - sunk.mean(), atol=1e-9)
        sunk = foot_compliance * (move.after.load - move.before.load)
        np.testing.assert_allclose(displacements[number], np.outer(sunk - sunk.mean(), HOME.rotation[2]), atol=1e-6)
    assert np.abs(heights).max() > 2e-4
