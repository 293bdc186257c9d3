"""Estimated leg links in model files, with the base of the same estimate."""

import dataclasses

import numpy as np
import pytest
from exporting import found, read_again
from robots import load_text, quadruped_mjcf

from equipoise.errors import ModelError, SettingsError
from equipoise.exports.formats import export
from equipoise.result.findings import Link
from equipoise.result.quantity import Quantity
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.links import link_names


def with_links(result):
    """Return the result with links a tenth heavier than the file's, their CoMs 3 mm off."""
    robot = result.robot_model
    names, links = link_names(robot.full_pinocchio), {}
    for leg in robot.legs.values():
        for joint in map(robot.full_pinocchio.getJointId, leg.joint_names):
            inertia = robot.full_pinocchio.inertias[joint]
            values = 1.1 * inertia.mass * np.array([1.0, *(inertia.lever + 3e-3)])
            pairs = zip(("mass", "moment_x", "moment_y", "moment_z"), values, strict=True)
            links[names[joint]] = Link(
                **{name: Quantity(name, "", float(value), 1e-6, "weak") for name, value in pairs}
            )
    return dataclasses.replace(result, links=links)


@pytest.fixture(params=["urdf", "mjcf"])
def result(request, a1, tmp_path):
    robot = a1 if request.param == "urdf" else load_text(tmp_path, quadruped_mjcf())
    return with_links(found(robot))


def test_links_and_robot_have_the_estimated_masses(result, tmp_path):
    robot, before = result.robot_model, result.robot_model.pinocchio
    path = export(result, robot.source.format, parameters="base,legs").save(
        tmp_path / f"new.{robot.source.path.suffix}"
    )
    again = read_again(path, robot)
    for leg in robot.legs.values():
        for joint in leg.joint_ids:
            old, new = before.inertias[joint], again.pinocchio.inertias[joint]
            assert new.mass == pytest.approx(1.1 * old.mass, rel=1e-6)
            np.testing.assert_allclose(new.lever, old.lever + 3e-3, atol=1e-8)
            np.testing.assert_allclose(new.inertia, 1.1 * np.array(old.inertia), atol=1e-8)
    composite = composite_parameters(again, again.joint_vector(dict(result.joint_position), "stance"))
    wanted = result.composite.parameters()  # the base that makes it one with these legs may be no body in its inertia
    np.testing.assert_allclose(composite.vector[:4], wanted.vector[:4], atol=1e-7)


def test_the_base_alone_goes_with_the_files_legs(result, tmp_path):
    robot = result.robot_model
    again = read_again(export(result, robot.source.format).save(tmp_path / robot.source.path.name), robot)
    for joint in robot.legs["FL"].joint_ids:
        assert again.pinocchio.inertias[joint].isApprox(robot.pinocchio.inertias[joint], 1e-9)


def test_links_without_the_base_are_refused(result):
    with pytest.raises(SettingsError, match="write both, with --parameters base,legs"):
        export(result, result.robot_model.source.format, parameters="legs")


def test_links_of_another_robot_are_refused(result):
    others = dict(zip("abcdefghijkl", result.links.values(), strict=True))
    with pytest.raises(ModelError, match=r"has a leg link '.*', which is not in the run"):
        export(dataclasses.replace(result, links=others), result.robot_model.source.format, parameters="base,legs")
