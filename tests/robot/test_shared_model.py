"""Shared models: immutable, and safe for several threads."""

import copy
import pickle
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import FrozenInstanceError, replace

import numpy as np
import pinocchio as pin
import pytest

from equipoise.robot.inertial import composite_parameters, stance_effective_parameters
from equipoise.robot.kinematics import Kinematics, foot_jacobians, foot_positions
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance
from equipoise.robot.statics import foot_forces, static_torques

THREADS = 3
ASKED = {
    "feet": foot_positions,
    "Jacobians": foot_jacobians,
    "composite": lambda robot, position: composite_parameters(robot, position).vector,
    "stance-effective": lambda robot, position: stance_effective_parameters(robot, position).vector,
    "torques": lambda robot, position: static_torques(robot, position, robot.legs),
}


@pytest.fixture
def impatient_threads():
    """Let threads switch as often as possible."""
    usual = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)  # [s]
    yield
    sys.setswitchinterval(usual)


@pytest.mark.parametrize("what", ASKED)
@pytest.mark.usefixtures("impatient_threads")
def test_threads_on_one_model_do_not_disturb_each_other(a1, what):
    stance = nominal_stance(a1)
    positions = [stance.joint_position + 0.1 * number for number in range(THREADS)]
    alone = [ASKED[what](a1, position) for position in positions]
    until = time.monotonic() + 1.0

    def disagreements(number):
        wrong = 0
        while time.monotonic() < until:
            wrong += not np.array_equal(ASKED[what](a1, positions[number]), alone[number])
        return wrong

    with ThreadPoolExecutor(THREADS) as pool:
        assert sum(pool.map(disagreements, range(THREADS))) == 0


def test_answers_are_the_callers_own(a1):
    kinematics, position = Kinematics(a1), nominal_stance(a1).joint_position
    asked = [kinematics.foot_positions, kinematics.com, kinematics.com_jacobian]
    asked += [lambda position: kinematics.feet_and_jacobians(position)[1]]
    asked += [lambda position: [pose.translation for pose in kinematics.joint_poses(position)]]
    for ask in asked:
        before = ask(position)
        kept = copy.deepcopy(before)
        assert not np.array_equal(ask(position + 0.1), kept)
        np.testing.assert_array_equal(before, kept)


def test_nothing_on_a_model_can_be_set(a1):
    for name in ("name", "pinocchio", "mass", "legs", "lower_limit", "imu_in_base", "scratch"):
        with pytest.raises(FrozenInstanceError):
            setattr(a1, name, None)


def test_arrays_and_tables_of_a_model_are_read_only(a1):
    for array in (a1.lower_limit, a1.upper_limit, a1.velocity_limit, a1.effort_limit, a1.leg_joints):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    for table in (a1.legs, a1.locked_joints):
        with pytest.raises(TypeError):
            table["FL"] = None


def test_the_pose_of_the_imu_is_the_callers_own(a1):
    before = np.array(a1.imu_in_base.homogeneous)
    pose = a1.imu_in_base
    pose.translation = np.ones(3)
    pose.rotation[0, 0] = 0.5
    np.testing.assert_array_equal(a1.imu_in_base.homogeneous, before)


def test_another_base_leaves_the_robot_as_it_was(a1):
    mass, base = a1.mass, pin.Inertia(a1.pinocchio.inertias[1])
    heavier = a1.with_base(pin.Inertia(base.mass + 2, base.lever, base.inertia))
    assert heavier.mass == pytest.approx(mass + 2)
    assert a1.mass == mass
    assert a1.pinocchio.inertias[1] == base


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, lambda robot: pickle.loads(pickle.dumps(robot)), replace])
def test_a_copy_of_a_model_is_one(a1, copied):
    again, position = copied(a1), nominal_stance(a1).joint_position
    assert isinstance(again, RobotModel)
    assert again.legs == a1.legs
    np.testing.assert_array_equal(foot_positions(again, position), foot_positions(a1, position))
    forces = (foot_forces(robot, position, robot.legs) for robot in (again, a1))
    np.testing.assert_array_equal(*forces)
    with pytest.raises(ValueError, match="read-only"):
        again.upper_limit[0] = 0
