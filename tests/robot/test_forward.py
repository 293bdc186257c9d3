"""Forward axis of the base link."""

import numpy as np
import pytest
from robots import FOUR_LEGS, quadruped_mjcf, quadruped_urdf

from equipoise import RobotDescription, nominal_stance, simulate
from equipoise.errors import ModelError, ModelWarning
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.model import RobotModel

TO_FILE = {
    "+y": [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
    "-x": -np.diag([1, 1, -1]),
    "-y": [[0, 1, 0], [-1, 0, 0], [0, 0, 1]],
}
# What a leg is called in the file, by where it is if x points forward.
CALLED = {
    "+y": {"FL": "FR", "FR": "RR", "RR": "RL", "RL": "FL"},
    "-x": {"FL": "RR", "FR": "RL", "RR": "FL", "RL": "FR"},
    "-y": {"FL": "RL", "FR": "FL", "RR": "FR", "RL": "RR"},
}


def load(folder, text, description=None, name="robot.urdf"):
    (folder / name).write_text(text)
    return RobotModel.from_file(folder / name, None, description)


def named(axis):
    return quadruped_urdf(joint_name=lambda leg, place: f"{CALLED[axis][leg]}_{place}")


@pytest.mark.parametrize("axis", CALLED)
def test_the_legs_names_determine_the_forward_axis(tmp_path, axis):
    plain = load(tmp_path, quadruped_urdf())
    with pytest.warns(
        ModelWarning, match=rf"^robot: \{axis} of 'trunk' points forward \(names of its legs\): the base"
    ):
        turned = load(tmp_path, named(axis))
    assert turned.source.forward == axis
    assert [leg.joint_names[0] for leg in turned.legs.values()] == ["FL_0", "FR_0", "RL_0", "RR_0"]
    stance = np.zeros(12)
    com, moved = (composite_parameters(robot, stance).com for robot in (plain, turned))
    np.testing.assert_allclose(np.array(TO_FILE[axis]) @ moved, com, atol=1e-12)
    with pytest.warns(ModelWarning):
        again = RobotModel.from_source(turned.source, "robot")  # as a run's folder does
    np.testing.assert_allclose(composite_parameters(again, stance).com, moved)


@pytest.mark.filterwarnings("ignore::equipoise.errors.ModelWarning")
@pytest.mark.parametrize(("name", "text"), [("robot.urdf", quadruped_urdf()), ("robot.xml", quadruped_mjcf())])
def test_a_described_forward_axis_gives_the_same_simulated_robot(tmp_path, name, text):
    robot = load(tmp_path, text, RobotDescription(forward="+y"), name)
    assert [leg.joint_names[0][:2] for leg in robot.legs.values()] == ["RL", "FL", "RR", "FR"]
    with simulate(robot, "ideal") as simulation:
        truth = simulation.truth.composite
    by_model = composite_parameters(robot, nominal_stance(robot).joint_position)
    np.testing.assert_allclose(truth.com, by_model.com, atol=1e-6)
    np.testing.assert_allclose(truth.inertia, by_model.inertia, atol=1e-6)


def test_names_that_fit_no_axis_are_refused_with_the_remedy(tmp_path):
    mirrored = {"FL": "FR", "FR": "FL", "RL": "RR", "RR": "RL"}
    text = quadruped_urdf(joint_name=lambda leg, place: f"{mirrored[leg]}_{place}")
    with pytest.raises(ModelError, match=r"do not fit their names .* set forward = .\+x"):
        load(tmp_path, text)
    robot = load(tmp_path, text, RobotDescription(forward="+x"))
    assert robot.legs["FL"].joint_names[0] == "FR_0"


def test_names_without_legs_keep_x_forward(tmp_path):
    robot = load(tmp_path, quadruped_urdf(joint_name=lambda leg, place: f"limb{FOUR_LEGS.index(leg)}_{place}"))
    assert robot.source.forward == "+x"


def test_a_robot_on_wheels_is_refused_with_a_remedy(tmp_path):
    wheels = "".join(
        f'<link name="{leg}_wheel"><inertial><mass value="0.2"/><inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" '
        f'izz="1e-3"/></inertial></link><joint name="{leg}_wheel_joint" type="continuous"><origin xyz="0 0 -0.2"/>'
        f'<parent link="{leg}_link_2"/><child link="{leg}_wheel"/><axis xyz="0 1 0"/></joint>'
        for leg in ("FL", "FR", "RL", "RR")
    )
    with pytest.raises(ModelError, match=r"stands on wheels \(joints .*FL_wheel_joint.* braked .* foot_radius"):
        load(tmp_path, quadruped_urdf(extra=wheels))
