"""Floor normal from the feet's diagonals and from the plane nearest to the feet."""

import numpy as np
import pinocchio as pin
import pytest

from equipoise.robot.floor import floor_normal_by_diagonals, floor_normals_by_fit

FLAT = np.array([[0.2, 0.15, -0.3], [0.2, -0.15, -0.3], [-0.2, 0.15, -0.3], [-0.2, -0.15, -0.3]])  # FL FR RL RR [m]
UP = np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize("turn", [np.zeros(3), np.array([0.2, -0.3, 1.0])])
def test_on_a_plane_both_computations_give_its_upward_normal(turn):
    rotation = pin.exp3(turn)
    feet, up = FLAT @ rotation.T, rotation @ UP
    normals, unevenness = floor_normals_by_fit(feet[None])
    np.testing.assert_allclose(floor_normal_by_diagonals(feet), up, atol=1e-12)
    np.testing.assert_allclose(normals[0], up, atol=1e-12)
    assert unevenness[0] < 1e-12


def test_a_lifted_diagonal_does_not_turn_the_normal_of_the_diagonals():
    lifted = FLAT + np.outer([0, 1, 1, 0], [0, 0, 0.06])
    np.testing.assert_allclose(floor_normal_by_diagonals(lifted), UP, atol=1e-12)


def test_the_fit_takes_three_feet_in_any_order_and_many_postures():
    rotations = [pin.exp3(np.array([0.1 * number, -0.2, 0.0])) for number in range(4)]
    feet = np.array([FLAT[[3, 0, 2]] @ rotation.T for rotation in rotations])
    normals, unevenness = floor_normals_by_fit(feet)
    np.testing.assert_allclose(normals, [rotation @ UP for rotation in rotations], atol=1e-12)
    assert unevenness.shape == (4,)


def test_unevenness_is_the_distance_from_the_plane_over_the_feet_distances():
    warped = FLAT + np.outer([1, -1, -1, 1], [0, 0, 0.003])
    _, unevenness = floor_normals_by_fit(warped[None])
    assert unevenness[0] == pytest.approx(0.003 / 0.15, rel=1e-6)  # the second singular value is the shorter side's
