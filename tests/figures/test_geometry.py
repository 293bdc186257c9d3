"""Shapes of robots."""

import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from robots import load_text, quadruped_mjcf, quadruped_urdf

from equipoise import nominal_stance
from equipoise.clearance.stand_ins import BASE_JOINT, LIMB_RADIUS_RATIO
from equipoise.figures.geometry import (
    Mesh,
    _coarser,
    _mended,
    at_posture,
    box,
    capsule,
    cylinder,
    drawn_shapes,
    sphere,
)
from equipoise.robot.kinematics import foot_positions

LENGTHS = st.floats(0.01, 2.0)


def volume(mesh):
    """Return the volume by the divergence theorem, positive only if all faces point outward."""
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    return float(np.einsum("ni,ni->", a, np.cross(b, c)) / 6)


@given(LENGTHS, LENGTHS, LENGTHS)
def test_a_box_is_closed_and_looks_outward(x, y, z):
    mesh = box(x, y, z)
    assert volume(mesh) == pytest.approx(x * y * z)
    assert np.allclose(np.ptp(mesh.vertices, axis=0), [x, y, z])


@given(LENGTHS, LENGTHS)
def test_round_bodies_have_nearly_the_exact_volume(radius, length):
    ball, tube = 4 / 3 * np.pi * radius**3, np.pi * radius**2 * length
    for mesh, exact in (
        (sphere(radius), ball),
        (cylinder(radius, length), tube),
        (capsule(radius, length), ball + tube),
    ):
        assert 0.96 * exact < volume(mesh) < exact
        outward = np.einsum("ni,ni->n", mesh.normals(), mesh.vertices)
        assert outward[np.linalg.norm(mesh.vertices, axis=1) > 1e-9].min() > 0


def test_the_built_in_robot_has_its_own_simple_bodies(a1):
    shapes = drawn_shapes(a1)
    assert [shape.joint for shape in shapes] == sorted(shape.joint for shape in shapes)
    base = shapes[0]
    assert (base.joint, base.part, base.kind) == (BASE_JOINT, "base", "box")
    assert np.allclose(np.ptp(base.vertices, axis=0), (0.267, 0.194, 0.114))
    feet = [shape for shape in shapes if shape.kind == "sphere"]
    assert sorted(shape.joint for shape in feet) == sorted(leg.joint_ids[-1] for leg in a1.legs.values())
    for foot in feet:  # where the model has them, in the frame of the joint that carries them
        leg = next(leg for leg in a1.legs.values() if leg.joint_ids[-1] == foot.joint)
        middle = a1.pinocchio.frames[leg.foot_frame_id].placement.translation
        assert np.allclose(foot.vertices.mean(axis=0), middle, atol=1e-12)
        assert np.ptp(foot.vertices[:, 2]) == pytest.approx(2 * leg.foot_radius)


@pytest.mark.parametrize("kind", ["urdf", "urdf of two joints a leg", "mjcf"])
def test_links_without_any_shape_get_one(tmp_path, kind):
    text = {"urdf": quadruped_urdf, "mjcf": quadruped_mjcf}.get(kind, lambda: quadruped_urdf(joints_per_leg=2))()
    robot = load_text(tmp_path, text)
    shapes = drawn_shapes(robot)
    carried = {shape.joint for shape in shapes}
    assert BASE_JOINT in carried
    for leg in robot.legs.values():
        assert {*leg.joint_ids[-2:]} <= carried
        (shank,) = (s for s in shapes if s.joint == leg.joint_ids[-1] and s.kind == "capsule")
        foot = robot.pinocchio.frames[leg.foot_frame_id].placement.translation
        near = np.linalg.norm(shank.vertices - foot, axis=1).min()
        assert near <= 0.6 * LIMB_RADIUS_RATIO * robot.leg_length + 1e-9, "its capsule reaches to the foot"


MESH = """solid s
facet normal 0 0 1
 outer loop
  vertex 0 0 0
  vertex 0.2 0 0
  vertex 0 0.1 0
 endloop
endfacet
endsolid s
"""


def test_meshes_of_the_users_file_are_used_until_it_changes(tmp_path):
    (tmp_path / "trunk.stl").write_text(MESH, encoding="utf-8")
    visual = '<visual><geometry><mesh filename="package://{}/trunk.stl" scale="2 2 2"/></geometry></visual>'
    text = quadruped_urdf().replace("<inertial>", visual.format(tmp_path.name) + "<inertial>", 1)
    robot = load_text(tmp_path, text)
    (mesh,) = (shape for shape in drawn_shapes(robot) if shape.kind == "mesh")
    assert mesh.part == "base"
    assert np.allclose(np.ptp(mesh.vertices, axis=0), [0.4, 0.2, 0])
    robot.source.path.write_text(text + " ", encoding="utf-8")
    assert not any(shape.kind == "mesh" for shape in drawn_shapes(robot)), "it is another file now"
    robot.source.path.write_text(text, encoding="utf-8")
    (tmp_path / "trunk.stl").unlink()
    assert not any(shape.kind == "mesh" for shape in drawn_shapes(robot))


def test_each_sphere_of_a_link_is_drawn_once(tmp_path):
    ball = '<collision><origin xyz="{} 0 0"/><geometry><sphere radius="0.05"/></geometry></collision>'
    balls = "".join(map(ball.format, (-0.1, 0.1, 0.1)))
    robot = load_text(tmp_path, quadruped_urdf().replace("<inertial>", balls + "<inertial>", 1))
    middles = [shape.vertices.mean(axis=0)[0] for shape in drawn_shapes(robot) if shape.joint == BASE_JOINT]
    assert middles == pytest.approx([-0.1, 0.1])


def test_visuals_that_cannot_be_drawn_are_replaced(tmp_path):
    flat = '<visual><geometry><box size="0.4 0.2 0"/></geometry></visual>'
    robot = load_text(tmp_path, quadruped_urdf().replace("<inertial>", flat + "<inertial>", 1))
    base = drawn_shapes(robot)[0]
    assert (base.joint, base.kind) == (BASE_JOINT, "box")
    assert np.ptp(base.vertices, axis=0).min() > 0


def at_stance(robot):
    stance = nominal_stance(robot).joint_position
    shapes = drawn_shapes(robot)
    return shapes, at_posture(robot, shapes, stance), foot_positions(robot, stance)


@pytest.mark.parametrize("write", [quadruped_urdf, quadruped_mjcf])
def test_shapes_at_a_posture_end_at_the_feet(tmp_path, write):
    robot = load_text(tmp_path, write())
    shapes, meshes, feet = at_stance(robot)
    assert {"base", "thigh", "shank"} <= {shape.part for shape in shapes}
    lowest = min(mesh.vertices[:, 2].min() for mesh in meshes)
    radius = next(iter(robot.legs.values())).foot_radius
    assert lowest == pytest.approx(feet[:, 2].min() - radius, abs=0.01)


def test_an_arm_that_is_held_does_not_hide_the_base(skewed):
    shapes, _, _ = at_stance(skewed)
    assert any(shape.part == "base" for shape in shapes)


def test_large_meshes_are_made_coarser():
    ball = sphere(1.0)
    fine = _coarser(ball, len(ball.faces))
    coarse = _coarser(ball, 100)
    assert fine is ball
    assert len(coarse.faces) < len(ball.faces)
    assert np.abs(np.linalg.norm(coarse.vertices, axis=1) - 1).max() < 1e-9


def test_a_mesh_that_was_joined_wrongly_gives_way_to_its_hull():
    corners = box(0.4, 0.2, 0.1).vertices
    shuffled = Mesh(np.vstack([corners, [[0.0, 0, 0.01]]]), np.array([[0, 1, 2], [2, 1, 3]]))
    mended = _mended(shuffled)
    assert volume(mended) == pytest.approx(0.4 * 0.2 * 0.1)
    assert len(mended.vertices) == 8
    whole = box(1, 1, 1)
    assert _mended(whole) is whole


@pytest.mark.parametrize("path", ["../../../../etc/passwd", "/dev/zero", "package://../../etc/passwd", "pipe.stl"])
def test_a_mesh_that_is_none_is_not_waited_for(a1, a1_urdf, tmp_path, path):
    """Simple bodies replace unreadable meshes."""
    os.mkfifo(tmp_path / "pipe.stl")
    visual = f'<visual><geometry><mesh filename="{path}"/></geometry></visual></link>'
    robot = load_text(tmp_path, a1_urdf.replace("</link>", visual, 1))
    assert {shape.kind for shape in drawn_shapes(robot)} == {"box", "cylinder", "sphere"}
