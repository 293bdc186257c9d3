"""The simulated robot in one call."""

import warnings

import numpy as np
import pytest

from equipoise import CalibrationSettings, calibrate, load_robot, nominal_stance, simulate
from equipoise.platforms.simulation import stable_timestep


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


def test_light_shanks_get_a_shorter_step_and_the_robot_stands_still(a1, a1_urdf, tmp_path):
    light = with_light_shanks(a1_urdf, tmp_path)
    stance = nominal_stance(light)
    usual = stable_timestep(a1, nominal_stance(a1))
    assert usual == 0.5e-3
    assert stable_timestep(light, stance) == usual / 2
    assert stable_timestep(light, stance, armature=0.01) == usual
    with simulate(light, "ideal") as simulation:
        assert simulation.platform._model.opt.timestep == usual / 2
        state = simulation.platform.read()
        assert np.abs(state.angular_velocity).max() < 0.02
        assert simulation.platform.control_period == pytest.approx(2e-3)
        result = calibrate(simulation.platform, light, CalibrationSettings("paper")).with_truth(simulation.truth)
    assert np.abs(result.errors()["composite"]["com_in_base"][:2]).max() < 5e-3


def test_a_payload_may_be_given_as_text(a1):
    with simulate(a1, "ideal", payload="2,0.1,0,0.05") as simulation:
        assert simulation.truth.composite.mass == pytest.approx(a1.mass + 2)
