"""Lifted feet from joint positions alone."""

import numpy as np
import pytest

from equipoise import nominal_stance
from equipoise.bayesian.lift_design import LiftDesign, lift_feet, lift_settings
from equipoise.experiments.posture import feet_in_posture
from equipoise.guard.footing import feet_are_lifted, look_at_feet
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.kinematics import inverse_kinematics
from equipoise.robot.posture import BodyPosture

LEVEL = BodyPosture()
TURNED = [BodyPosture(roll=0.15, yaw=0.2, crouch=0.1), BodyPosture(pitch=-0.15)]


@pytest.fixture(scope="module", params=["a1", "two_jointed", "skewed"])
def robot(request):
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="module")
def postures(robot):
    """Level, and turned where the legs have joints enough to keep their feet meanwhile."""
    three_jointed = all(len(leg.joints) == 3 for leg in robot.legs.values())
    return [LEVEL, *TURNED] if three_jointed else [LEVEL]


@pytest.fixture(scope="module")
def joints(robot):
    stance = nominal_stance(robot)
    return lambda feet: inverse_kinematics(robot, feet, stance.joint_position)


@pytest.fixture(scope="module")
def com(robot):
    return composite_parameters(robot, nominal_stance(robot).joint_position).com


def test_four_feet_on_the_floor_are_not_up_however_the_body_is_turned(robot, postures, joints, com):
    stance = nominal_stance(robot)
    for posture in postures:
        lifted, up = look_at_feet(robot, stance, joints(feet_in_posture(stance, com, posture)))
        assert not lifted
        assert np.allclose(up, posture.rotation[2], atol=1e-3)


@pytest.mark.parametrize("diagonal", ["FL_RR", "FR_RL"])
@pytest.mark.parametrize("share", [1.0, 0.5])
def test_two_feet_in_the_air_are_up_also_in_the_lowest_step(robot, postures, joints, com, diagonal, share):
    stance = nominal_stance(robot)
    for posture in postures:
        design = LiftDesign(posture, diagonal, 1)
        standing, raised = lift_feet(stance, com, design, share * lift_settings(stance).height)
        lifted, up = look_at_feet(robot, stance, joints(raised))
        assert lifted
        assert np.allclose(up, posture.rotation[2], atol=1e-3)
        assert not feet_are_lifted(robot, stance, joints(standing))


def test_feet_stay_up_while_the_body_turns_over_two(a1):
    stance = nominal_stance(a1)
    com = composite_parameters(a1, stance.joint_position).com
    _, raised = lift_feet(stance, com, LiftDesign(LEVEL, "FL_RR", 1), lift_settings(stance).height)
    rolled = LiftDesign(LEVEL, "FL_RR", 1, turn="roll").feet(raised, com, 0.05)
    turned = inverse_kinematics(a1, rolled, stance.joint_position)
    assert feet_are_lifted(a1, stance, turned)
