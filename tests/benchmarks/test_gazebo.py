"""The URDF of simulated robots, and the platform in Gazebo 11 where its root exists."""

import os
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))  # last: some names equal those of tests
from gazebo.gazebo_platform import LACKS, GazeboPlatform, Ode
from gazebo.root import ROOT, SERVER
from worlds.urdf import urdf

from equipoise import JointCommand, Payload, load_robot, nominal_stance, simulate
from equipoise.robot.inertial import components
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.effects import REALISTIC

ROBOT = load_robot("unitree_a1")
STANCE = nominal_stance(ROBOT)
SIZES = REALISTIC.without_effects(LACKS)
LOAD = "1.5,0.1,0,0.08,0.01,0.02,0.03"
with simulate(ROBOT, SIZES, LOAD, seed=3) as in_mujoco:
    TRUTH = in_mujoco.truth
needs_gazebo = pytest.mark.skipif(
    os.geteuid() != 0 or not (ROOT / SERVER[1:]).exists(),
    reason="Gazebo 11 is not installed: benchmarks/gazebo/root.py",
)


def test_the_urdf_has_the_payload_and_the_drawn_legs():
    errors = DrawnErrors.draw(SIZES, len(ROBOT.joint_names), 3)
    text = ElementTree.tostring(urdf(ROBOT, STANCE, errors, Payload.parse(LOAD)), encoding="unicode")
    model = pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
    q = pin.neutral(model)
    for name, angle in zip(ROBOT.joint_names, STANCE.joint_position, strict=True):
        joint = model.joints[model.getJointId(name)]  # a joint without limits is a cosine and a sine
        q[joint.idx_q : joint.idx_q + 2] = np.cos(angle), np.sin(angle)
    data = model.createData()
    pin.ccrba(model, data, q, np.zeros(model.nv))
    assert data.Ig.mass == pytest.approx(TRUTH.composite.mass, abs=1e-6)
    np.testing.assert_allclose(data.Ig.inertia, TRUTH.composite.inertia, atol=1e-6)


@needs_gazebo
def test_gazebo_simulates_the_robot_of_mujoco():
    with GazeboPlatform(ROBOT, SIZES, Payload.parse(LOAD), 3, Ode(kp=1e7, kd=1e4, max_vel=100)) as platform:
        for name in ("composite", "base", "stance_effective"):
            found, true = components(getattr(platform.truth, name)), components(getattr(TRUTH, name))
            np.testing.assert_allclose(found, true, atol=1e-5)
        states = [platform.step(JointCommand(np.array(STANCE.joint_position))) for _ in range(200)]
        force = np.mean([state.acceleration_in_imu for state in states], axis=0)
        drift = states[-1].joint_position - states[0].joint_position
    assert np.linalg.norm(force) == pytest.approx(9.81, abs=0.1)
    assert np.abs(drift).max() < 5e-3
