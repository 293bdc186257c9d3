"""Friction, damping and reported torques of the joints in MuJoCo, recovered from their motion."""

import copy

import mujoco
import numpy as np
import pytest
from robots import load_text, quadruped_urdf

from equipoise import EffectSizes, nominal_stance, simulate

pytestmark = pytest.mark.usefixtures("fine_engine")

COULOMB, VISCOUS, ARMATURE = 0.3, 0.05, 0.01
JOINT = 1  # the front left thigh


@pytest.fixture(scope="module", params=["A1", "light legs"])
def robot(request, a1, tmp_path_factory):
    return a1 if request.param == "A1" else load_text(tmp_path_factory.mktemp("robot"), quadruped_urdf())


def swung(robot, frequency, size, timestep, sizes):
    """A thigh swung in the air: its speed at each step's end, and the friction that the reported torque overcame [Nm]."""
    with simulate(robot, sizes, timestep=timestep) as simulation:
        platform, model = simulation.platform, simulation.platform._model
    stance, dof = nominal_stance(robot), platform._simulated.dof
    model.opt.gravity[:] = 0
    platform._place(stance.joint_position, stance.base_height + 5)
    data, moment = platform._data, mujoco.MjData(model)
    smooth = copy.copy(model)
    smooth.dof_armature[dof], smooth.dof_frictionloss[:], smooth.dof_damping[:] = sizes.armature, 0, 0
    needed, speeds, friction = np.zeros(model.nv), [], []
    for time in np.arange(0, 4 / frequency, timestep):
        data.ctrl[:] = stance.joint_position
        data.ctrl[JOINT] += size * np.sin(2 * np.pi * frequency * time)
        moment.qpos[:], moment.qvel[:] = data.qpos, data.qvel
        mujoco.mj_step(model, data)
        change = data.qvel - moment.qvel
        mujoco.mj_forward(smooth, moment)
        mujoco.mj_mulM(smooth, moment, needed, change / timestep)
        torque = platform._reported_torque(data.actuator_force, change[dof])
        friction.append((torque * platform._errors.torque_gain - (needed + moment.qfrc_bias)[dof])[JOINT])
        speeds.append(data.qvel[dof[JOINT]])
    begin = len(speeds) // 4
    return np.array(speeds[begin:]), np.array(friction[begin:])


def lead_of(friction, speed, phase):
    """Return the lead of the first harmonic of friction over that of the speed's sign [deg]."""
    wave = np.exp(-1j * phase)
    return np.degrees(np.angle((friction * wave).sum() / (np.sign(speed) * wave).sum()))


@pytest.mark.parametrize("timestep", [0.5e-3, 1e-3])
@pytest.mark.parametrize(("frequency", "size"), [(1, 0.1), (3, 0.05), (6, 0.05)])
def test_friction_is_coulombs_and_viscous_whatever_the_motion(robot, frequency, size, timestep):
    sizes = EffectSizes(coulomb_friction=COULOMB, viscous_friction=VISCOUS, armature=ARMATURE, torque_gain=0.05)
    speed, friction = swung(robot, frequency, size, timestep, sizes)
    moving = np.abs(speed) > 0.05 * np.abs(speed).max()
    columns = np.column_stack([np.sign(speed), speed])[moving]
    coulomb_friction, viscous_friction = np.linalg.lstsq(columns, friction[moving], rcond=None)[0]
    assert coulomb_friction == pytest.approx(COULOMB, rel=0.01)
    assert viscous_friction == pytest.approx(VISCOUS, rel=0.02)
    phase = 2 * np.pi * frequency * timestep * np.arange(len(speed))
    assert abs(lead_of(friction - VISCOUS * speed, speed, phase)) < 1.5


def test_a_joint_that_friction_holds_stays_where_it_is(a1):
    # Pushed by half of what friction holds, for a second.
    stance = nominal_stance(a1)
    with simulate(a1, EffectSizes(coulomb_friction=COULOMB)) as simulation:
        platform = simulation.platform
        model, data, joint = platform._model, platform._data, platform._simulated.qpos[JOINT]
    model.opt.gravity[:] = 0
    platform._place(stance.joint_position, stance.base_height + 5)
    data.ctrl[:] = stance.joint_position
    data.ctrl[JOINT] += 0.5 * COULOMB / platform._simulated.kp[JOINT]
    for _ in range(2000):
        mujoco.mj_step(model, data)
    assert abs(data.qpos[joint] - stance.joint_position[JOINT]) < 0.1 * 0.5 * COULOMB / platform._simulated.kp[JOINT]
