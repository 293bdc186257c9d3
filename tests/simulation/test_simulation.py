"""The simulated robot in one call."""

import warnings

import numpy as np
import pinocchio as pin
import pytest

from equipoise import PaperMethod, calibrate, load_robot, nominal_stance, simulate


def with_light_shanks(a1_urdf, folder):
    """An A1 whose shanks have a tenth of their inertia."""
    shank = (
        '<inertia ixx="0.002997972" ixy="0" ixz="-0.000141163" iyy="0.003014022" iyz="0" izz="3.2426e-05"/>',
        '<origin xyz="0.006435 0 -0.107388"/>\n      <mass value="0.166"/>',
    )
    assert all(text in a1_urdf for text in shank)
    light = a1_urdf.replace(shank[0], '<inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="5e-6"/>')
    light = light.replace(shank[1], '<origin xyz="0 0 -0.02"/>\n      <mass value="0.06"/>')
    light = light.replace('<mass value="0.06"/><inertia', '<mass value="0.005"/><inertia')
    file = folder / "light.urdf"
    file.write_text(light, encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return load_robot(str(file))


@pytest.mark.parametrize("timestep", [0.5e-3, 1e-3])
def test_light_shanks_are_damped_and_do_not_chatter(a1_urdf, tmp_path, timestep):
    light = with_light_shanks(a1_urdf, tmp_path)
    stance = nominal_stance(light)
    inertia = pin.crba(light.pinocchio, light.pinocchio.createData(), light.configuration(stance.joint_position))
    _, damping = light.gains(stance.hip_height)
    assert damping * timestep > 4 * np.diag(inertia)[6:].min()  # it takes four times a joint's speed in a step
    with simulate(light, "ideal", timestep=timestep) as simulation:
        state = simulation.platform.read()
        assert np.abs(state.angular_velocity_in_imu).max() < 0.02
        assert simulation.platform.control_period == pytest.approx(2e-3)
        result = calibrate(simulation.platform, light, PaperMethod()).with_truth(simulation.truth)
    assert np.abs(result.composite.com_in_base.errors[:2]).max() < 5e-3


def test_a_payload_may_be_given_as_text(a1):
    with simulate(a1, "ideal", payload="2,0.1,0,0.05") as simulation:
        assert simulation.truth.composite.mass == pytest.approx(a1.mass + 2)
