"""Export of bodies whose CoM lies outside the robot, and of payloads on it."""

import dataclasses
import json
import warnings

import numpy as np
import pytest
from commands import fails
from exporting import found, make_run
from robots import load_text, quadruped_mjcf, quadruped_urdf

from equipoise import export, load_robot
from equipoise.errors import ModelWarning, NotEstimatedError
from equipoise.exports.formats import FORMATS
from equipoise.result.body import Body
from equipoise.robot.catalog import CATALOG
from equipoise.robot.inertial import InertialParameters


def displaced(result, com):
    """Return a result whose composite has another CoM, as after an edit of its file."""
    body = result.composite.parameters()
    moved = InertialParameters(body.mass, np.array(com, dtype=float), body.inertia)
    return dataclasses.replace(result, composite=Body.complete(moved, model=result.nominal.composite))


@pytest.mark.parametrize("name", [name for name, row in FORMATS.items() if row.bodies and name not in ("mjcf", "usd")])
@pytest.mark.parametrize("com", [(0.5, 0.5, 0.5), (-2.0, 2.8, -16.0), (0.0, 0.0, -0.6)], ids=["aside", "mm", "below"])
def test_a_com_outside_the_robot_is_refused(name, com, a1):
    with pytest.raises(NotEstimatedError) as error:
        export(displaced(found(a1), com), name)
    place = ", ".join(f"{value:.4g}" for value in com)
    assert str(error.value).startswith(f"the composite's CoM ({place}) m lies outside 'unitree_a1': x -0.")
    assert str(error.value).endswith(
        " m at its stance, with room for a payload. Was the result edited, or is it in millimetres? Estimate it again from "
        "the run's recordings (equipoise estimate RUN), or write it anyway with --force"
    )


def test_a_forced_export_has_a_note(a1):
    out = export(displaced(found(a1), (0.5, 0.5, 0.5)), "quadruped-pympc", force=True)
    assert out.notes[0].startswith("FORCED: the composite's CoM (0.5, 0.5, 0.5) m lies outside 'unitree_a1': ")
    assert out.notes[0] in out.text


def test_without_its_model_bounds_come_from_the_inertia(a1):
    result = dataclasses.replace(found(a1), robot_model=None)
    assert export(result, "quadruped-pympc").notes == ()
    for com in ((0.7, 0.0, 0.0), (0.0, -0.7, 0.0)):
        with pytest.raises(NotEstimatedError, match=r" m within 3 radii of gyration of its model\."):
            export(displaced(result, com), "quadruped-pympc")


@pytest.mark.parametrize(
    ("share", "com"),
    [(0.5, (0.0, 0.0, 0.3)), (0.8, (0.05, 0.0, 0.25)), (0.3, (0.2, 0.0, 0.05)), (0.3, (0.0, 0.1, -0.15))],
    ids=["on top", "a heavy one", "in front", "below"],
)
def test_payloads_that_a_robot_carries_are_written(share, com, a1):
    mass = share * a1.mass
    added = InertialParameters(mass, np.array(com), mass * np.diag([0.004, 0.004, 0.004]))
    result = found(a1, added)
    for name in ("urdf", "xacro", "quadruped-pympc", "mit-cheetah"):
        assert export(result, name).content


@pytest.mark.parametrize("text", [quadruped_urdf(), quadruped_urdf(joints_per_leg=2), quadruped_urdf(arm_joints=2)])
def test_robots_of_other_shapes_are_written(text, tmp_path):
    assert export(found(load_text(tmp_path, text)), "json").content


@pytest.mark.parametrize("name", CATALOG)
def test_robots_of_the_catalogue_are_written_with_a_third_of_their_mass_on_top(name):
    if CATALOG[name].install:
        pytest.skip(f"{name} is not installed: it is NOT TRIED")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        robot = load_robot(name)
    mass, leg = robot.mass / 3, robot.leg_length
    added = InertialParameters(mass, leg * np.array([0.1, 0.0, 0.9]), 0.02 * mass * leg**2 * np.eye(3))
    assert export(found(robot, added), "json").content


def test_robots_of_mjcf_are_written(tmp_path):
    assert export(found(load_text(tmp_path, quadruped_mjcf(), name="robot.xml")), "json").content


def test_an_edited_result_is_refused_by_the_command(a1, tmp_path, capsys):
    make_run(tmp_path / "run", a1)
    file = tmp_path / "run" / "calibration.json"
    table = json.loads(file.read_text(encoding="utf-8"))
    table["composite"]["com_in_base"] = [0.5, 0.5, 0.5]
    file.write_text(json.dumps(table), encoding="utf-8")
    for name in ("urdf", "quadruped-pympc"):
        message = fails(capsys, 8, "export", str(tmp_path / "run"), "--to", name)
        assert "the composite's CoM (0.5, 0.5, 0.5) m lies outside 'unitree_a1'" in message
    assert not (tmp_path / "run" / "export").exists()


def test_the_written_base_is_the_composite_minus_the_models_legs(a1):
    result = found(a1)
    far = InertialParameters(5.0, np.array([0.5, 0.5, 0.5]), np.eye(3))
    edited = dataclasses.replace(result, base=Body.complete(far, model=result.nominal.base))
    written, usual = (json.loads(export(one, "json").text)["base"] for one in (edited, result))
    assert written["com_in_base"] == usual["com_in_base"]
