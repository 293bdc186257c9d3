"""What a robot looks like: its file's shapes, and stand-ins."""

import numpy as np
import pytest
from robots import load_text, quadruped_mjcf, quadruped_urdf

from equipoise import nominal_stance
from equipoise.outputs.report.meshes import ellipsoid, mesh_of
from equipoise.robot.kinematics import foot_positions
from equipoise.robot.shapes import Shape, robot_shapes


def volume(corners, triangles):
    a, b, c = (corners[triangles[:, k]] for k in range(3))
    return abs(float(np.einsum("ni,ni->n", a, np.cross(b, c)).sum())) / 6


def at_stance(robot):
    stance = nominal_stance(robot).joint_position
    return robot_shapes(robot, stance), foot_positions(robot, stance)


def test_the_a1_is_drawn_from_its_own_file(a1):
    shapes, _ = at_stance(a1)
    assert all(shape.from_model for shape in shapes)
    assert [(shape.kind, shape.size) for shape in shapes if shape.part == "base"] == [("box", (0.1335, 0.097, 0.057))]


@pytest.mark.parametrize("write", [quadruped_urdf, quadruped_mjcf])
def test_every_robot_has_a_base_legs_and_feet(tmp_path, write):
    robot = load_text(tmp_path, write())
    shapes, feet = at_stance(robot)
    assert {shape.part for shape in shapes} == {"base", "leg"}
    for foot in feet:
        assert any(shape.kind == "sphere" and np.allclose(shape.position, foot, atol=1e-9) for shape in shapes)
    stand_ins = [shape for shape in shapes if shape.kind == "capsule"]
    assert sorted(round(shape.size[2], 6) for shape in stand_ins) == [0.04] * 4 + [0.1] * 8  # hips; thighs and shanks
    for shape in stand_ins:
        assert np.linalg.det(shape.rotation) == pytest.approx(1.0)


def test_an_arm_that_is_held_does_not_hide_the_base(skewed):
    shapes, _ = at_stance(skewed)
    assert any(shape.part == "base" for shape in shapes)


@pytest.mark.parametrize(
    ("kind", "size", "expected"),
    [
        ("box", (0.1, 0.2, 0.3), 8 * 0.1 * 0.2 * 0.3),
        ("sphere", (0.1, 0.1, 0.1), 4 / 3 * np.pi * 0.1**3),
        ("cylinder", (0.1, 0.1, 0.2), np.pi * 0.1**2 * 0.4),
        ("capsule", (0.1, 0.1, 0.2), np.pi * 0.1**2 * 0.4 + 4 / 3 * np.pi * 0.1**3),
    ],
)
def test_meshes_are_closed_and_about_as_large_as_their_shapes(kind, size, expected):
    shape = Shape(kind, "leg", size, np.array([1.0, 2.0, 3.0]), np.eye(3))
    corners, triangles = mesh_of(shape)
    assert volume(corners - shape.position, triangles) == pytest.approx(expected, rel=0.2)
    np.testing.assert_allclose((corners.max(axis=0) + corners.min(axis=0)) / 2, shape.position, atol=1e-9)


def test_an_ellipsoid_is_one():
    turned = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    half, middle = np.array([1e-3, 2e-3, 3e-3]), np.array([0.1, 0.2, 0.3])
    trace = ellipsoid(middle, half, turned)
    points = np.column_stack([trace[axis] for axis in "xyz"]) / 1000 - middle
    np.testing.assert_allclose(np.linalg.norm(points @ turned / half, axis=1), 1.0, atol=2e-3)
