"""Scale of a robot relative to an A1."""

import numpy as np
import pytest

from equipoise import nominal_stance
from equipoise.robot.scale import Scale


def test_an_a1_is_the_unit(a1):
    scale = nominal_stance(a1).scale
    assert (scale.length, scale.time, scale.torque) == pytest.approx((1, 1, 1), rel=0.03)


def test_factors_of_lengths_times_and_torques():
    one, other = Scale.of(10.0, 0.3), Scale.of(80.0, 0.6)
    factors = [getattr(other, name) / getattr(one, name) for name in ("length", "time", "torque")]
    assert factors == pytest.approx([2, np.sqrt(2), 16])


def test_a_stances_scale_is_that_of_its_robot_at_its_height(a1):
    stance = nominal_stance(a1)
    assert stance.scale == Scale.of(a1.mass, stance.hip_height)
    assert stance.scale.length == stance.hip_height / 0.312
    assert stance.scale.torque == a1.mass * 9.81 * stance.hip_height / 38.0


def test_gains_scale_with_torque(a1):
    height = nominal_stance(a1).hip_height
    assert a1.gains(height) == pytest.approx((100 * a1.mass * 9.81 * height / 38, 3 * a1.mass * 9.81 * height / 38))
