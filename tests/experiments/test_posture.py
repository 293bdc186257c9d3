"""Postures of the base with all feet on the floor, and rejected postures."""

import numpy as np
import pytest
from robots import load_text, quadruped_urdf
from tilting import sides

from equipoise import nominal_stance
from equipoise.errors import ReachError
from equipoise.experiments.posture import check_posture, feet_in_posture, stance_line
from equipoise.robot.description import RobotDescription
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.kinematics import foot_positions
from equipoise.robot.posture import BodyPosture

POSTURES = (
    BodyPosture(),
    BodyPosture(roll=0.25, crouch=0.1),
    BodyPosture(pitch=-0.2, yaw=0.3, crouch=0.2),
    BodyPosture(roll=-0.2, pitch=0.2, yaw=-0.1),
)
DIAGONALS = ("FL_RR", "FR_RL")


@pytest.fixture(scope="module", params=["a1", "skewed"])
def robot(request):
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="module")
def stance(robot):
    return nominal_stance(robot)


@pytest.fixture(scope="module")
def com(robot, stance):
    return composite_parameters(robot, stance.joint_position).com


def distances(feet):
    return np.linalg.norm(feet[:, None] - feet[None], axis=2)


@pytest.mark.parametrize("offset", [-0.02, 0.0, 0.006])
@pytest.mark.parametrize("diagonal", DIAGONALS)
@pytest.mark.parametrize("posture", POSTURES)
def test_the_support_line_is_at_the_requested_offset(stance, com, posture, diagonal, offset):
    feet = feet_in_posture(stance, com, posture, diagonal, offset)
    left, right = (feet[foot] for foot in sides(diagonal))
    ahead = np.cross(left - right, posture.rotation[2])  # level, across the line
    ahead /= np.linalg.norm(ahead)
    assert (posture.rotation @ ahead)[0] > 0
    assert ahead @ (left - com) == pytest.approx(offset, abs=1e-12)
    assert ahead @ (right - com) == pytest.approx(offset, abs=1e-12)


@pytest.mark.parametrize("diagonal", [None, *DIAGONALS])
@pytest.mark.parametrize("posture", POSTURES)
def test_feet_stay_in_place_and_the_com_is_at_the_requested_height(stance, com, posture, diagonal):
    feet = feet_in_posture(stance, com, posture, diagonal, 0.01)
    np.testing.assert_allclose(distances(feet), distances(stance.feet_in_base), atol=1e-12)
    in_world = (feet - com) @ posture.rotation.T
    assert in_world[:, 2] == pytest.approx(stance.feet_in_base[:, 2] - com[2] + posture.crouch * stance.hip_height)
    # The base has the requested rotation: feet keep their directions in the world.
    world = in_world - in_world.mean(axis=0)
    np.testing.assert_allclose(world, stance.feet_in_base - stance.feet_in_base.mean(axis=0), atol=1e-12)


@pytest.mark.parametrize("posture", POSTURES)
def test_without_a_line_the_com_is_at_the_requested_position_along_x(stance, com, posture):
    """It does not move sideways, which legs with two joints cannot do."""
    aside = com[1] - stance.feet_in_base[:, 1].mean()
    moved = BodyPosture(posture.roll, posture.pitch, posture.yaw, posture.crouch, ahead=0.1, aside=-0.05)
    for wanted, expected in ((posture, (0, 0)), (moved, (0.1, -0.05))):
        feet = feet_in_posture(stance, com, wanted)
        off = (wanted.rotation @ (com - feet.mean(axis=0)))[:2]
        assert off == pytest.approx(stance.hip_height * np.array(expected) + [0, aside], abs=1e-12)


@pytest.mark.parametrize("diagonal", DIAGONALS)
def test_lines_run_from_right_to_left_with_a_normal_ahead(stance, diagonal):
    direction, normal, middle = stance_line(stance, diagonal)
    left, right = (stance.feet_in_base[foot] for foot in sides(diagonal))
    np.testing.assert_allclose(middle + direction * np.linalg.norm(left - right) / 2, left, atol=1e-12)
    np.testing.assert_allclose(middle - direction * np.linalg.norm(left - right) / 2, right, atol=1e-12)
    assert direction[1] > 0
    assert normal[0] > 0
    assert (normal @ direction, normal[2], np.linalg.norm(normal)) == pytest.approx((0, 0, 1), abs=1e-12)


def test_a_posture_within_reach_has_its_feet_where_they_should_be(robot, stance, com):
    feet = feet_in_posture(stance, com, POSTURES[1])
    position = check_posture(robot, stance, feet)
    np.testing.assert_allclose(foot_positions(robot, position), feet, atol=1e-5)


# --- rejected postures


def synthetic(tmp_path, hip_limit=0.9, **changes):
    text = quadruped_urdf(**changes).replace('lower="-0.9" upper="0.9"', f'lower="-{hip_limit}" upper="{hip_limit}"')
    robot = load_text(tmp_path, text)
    stance = nominal_stance(robot)
    return robot, stance, composite_parameters(robot, stance.joint_position).com


def refusal(robot, stance, com, posture):
    with pytest.raises(ReachError) as error:
        check_posture(robot, stance, feet_in_posture(stance, com, posture))
    return str(error.value)


@pytest.mark.parametrize(
    ("posture", "leg"),
    [(BodyPosture(crouch=-0.4), "(FL|FR|RL|RR)"), (BodyPosture(roll=0.5, aside=-0.5), "[FR]L")],
)
def test_a_foot_out_of_reach_is_named(a1, posture, leg):
    stance = nominal_stance(a1)
    com = composite_parameters(a1, stance.joint_position).com
    with pytest.raises(ReachError, match=f"the {leg} foot misses its place by .* mm"):
        check_posture(a1, stance, feet_in_posture(stance, com, posture))


def test_legs_without_abduction_cannot_roll(two_jointed):
    stance = nominal_stance(two_jointed)
    com = composite_parameters(two_jointed, stance.joint_position).com
    assert "the leg is too short or lacks a joint" in refusal(two_jointed, stance, com, BodyPosture(roll=0.2))


def test_a_leg_nearly_straight_is_named(tmp_path):
    robot, stance, com = synthetic(tmp_path)
    ratio = (stance.hip_height - 0.02) / 0.4
    crouch = -(0.97 - ratio) * 0.4 / stance.hip_height
    assert refusal(robot, stance, com * [0, 1, 1], BodyPosture(crouch=crouch)).startswith(("the FL leg would be 97%",
        "the RL leg would be 97%", "the FR leg would be 97%", "the RR leg would be 97%"))  # fmt: skip


def test_a_leg_folded_up_is_named(tmp_path):
    robot, stance, com = synthetic(tmp_path)
    crouch = (stance.hip_height - 0.02 - 0.12) / stance.hip_height
    message = refusal(robot, stance, com, BodyPosture(crouch=crouch))
    assert message.endswith("leg would be 30% of its length")


def test_a_joint_near_its_limit_is_named(tmp_path):
    robot, stance, com = synthetic(tmp_path)
    wanted = check_posture(robot, stance, feet_in_posture(stance, com, BodyPosture(crouch=0.2)))
    knee = robot.legs["RL"].joints[-1]
    bounds = (-2.7, wanted[knee] + 0.01) if wanted[knee] < 0 else (wanted[knee] - 0.01, 2.7)
    name = robot.joint_names[knee]
    # The nominal stance needs a straighter knee, so this one is given explicitly.
    limited = RobotDescription(joint_limits={name: bounds})
    robot = load_text(tmp_path, quadruped_urdf(), limited)
    feet = feet_in_posture(stance, com, BodyPosture(crouch=0.2))
    with pytest.raises(ReachError, match=rf"joint '{name}' would be 0\.01\d rad from its limit"):
        check_posture(robot, stance, feet)


def test_a_motor_too_weak_is_named(tmp_path):
    robot, stance, com = synthetic(tmp_path, trunk_mass=60.0)
    message = refusal(robot, stance, com, BodyPosture(crouch=0.3))
    assert message.startswith("joint '")
    assert message.endswith("% of its torque limit")
    percent = int(message.split("% of its torque")[0].split()[-1])
    assert percent > 90
    # Two legs reach the torque limit before four.
    robot, stance, com = synthetic(tmp_path, trunk_mass=40.0)
    feet = feet_in_posture(stance, com, BodyPosture())
    check_posture(robot, stance, feet)
    with pytest.raises(ReachError, match="of its torque limit"):
        check_posture(robot, stance, feet, ("FL", "RR"))


@pytest.mark.parametrize(
    ("posture", "where"),
    [(BodyPosture(ahead=0.62, crouch=0.3), "front or rear"), (BodyPosture(aside=0.52, crouch=0.3), "left or right")],
)
def test_a_com_near_the_edge_of_the_feet_is_rejected(tmp_path, posture, where):
    robot, stance, com = synthetic(tmp_path, hip_limit=1.4)
    assert f"the {where} feet" in refusal(robot, stance, com, posture)
