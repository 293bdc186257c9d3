"""Catalogue of robots."""

import sys
import types
import warnings
from importlib import metadata, util

import pytest
from robots import load_text, quadruped_mjcf, quadruped_urdf

from equipoise.errors import MissingDependencyError, ModelError, ModelWarning
from equipoise.robot.audit import audit
from equipoise.robot.catalog import BUILT_IN_ROBOT, CATALOG, load_robot
from equipoise.robot.description import LEG_NAMES, RobotDescription
from equipoise.robot.inertial import base_parameters, composite_parameters
from equipoise.robot.stance import nominal_stance

# Joints a leg; the robots that have none for abduction.
TWO_JOINTS = {"solo8"}


@pytest.fixture
def quietly():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        yield


@pytest.fixture
def bare_machine(monkeypatch):
    """Emulate a machine without packages of robots."""

    def no_distribution(name):
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "distribution", no_distribution)
    monkeypatch.setattr(util, "find_spec", lambda name: None)


@pytest.mark.parametrize("name", CATALOG)
def test_every_robot_whose_package_is_there_is_found(name):
    entry = CATALOG[name]
    assert entry.name == name
    assert entry.note
    try:
        found = entry.find()
    except MissingDependencyError as error:
        pytest.skip(str(error))
    assert found.is_file()


@pytest.mark.usefixtures("bare_machine")
@pytest.mark.parametrize("name", [name for name in CATALOG if name != BUILT_IN_ROBOT])
def test_no_robot_is_found_without_its_package(name):
    with pytest.raises(MissingDependencyError) as error:
        CATALOG[name].find()
    assert f"robot {name!r} comes with the package {CATALOG[name].source}, which is not installed" in str(error.value)
    assert CATALOG[name].hint in str(error.value)


@pytest.mark.parametrize("name", CATALOG)
def test_every_robot_that_is_there_has_mass_and_a_stance(quietly, name):
    try:
        robot = load_robot(name)
    except MissingDependencyError as error:
        pytest.skip(str(error))
    assert robot.name == name
    assert list(robot.legs) == list(LEG_NAMES)
    assert {len(leg.joints) for leg in robot.legs.values()} == {2 if name in TWO_JOINTS else 3}
    assert 1 < robot.mass < 200
    assert base_parameters(robot).physical_defect() is None
    stance = nominal_stance(robot)
    assert composite_parameters(robot, stance.joint_position).physical_defect() is None
    assert 0 < stance.hip_height < robot.leg_length + max(leg.foot_radius for leg in robot.legs.values())


@pytest.mark.usefixtures("bare_machine")
def test_a_missing_package_is_named_with_its_command():
    with pytest.raises(MissingDependencyError) as error:
        load_robot("go2")
    assert str(error.value) == (
        "robot 'go2' comes with the package example-robot-data, which is not installed: "
        "pip install 'equipoise[robots]'; 'unitree_a1' is built in"
    )
    assert error.value.exit_code == 7
    with pytest.raises(
        MissingDependencyError, match="the package pybullet, which is not installed: pip install pybullet;"
    ):
        load_robot("aliengo")


@pytest.mark.usefixtures("bare_machine")
def test_the_built_in_robot_needs_no_package():
    assert load_robot(BUILT_IN_ROBOT).mass == pytest.approx(12.458)


@pytest.mark.usefixtures("bare_machine")
def test_the_catalogue_lists_installed_robots_and_commands_for_others():
    rows = dict(CATALOG)
    assert [row.name for row in rows.values()] == list(CATALOG)
    built_in = rows.pop(BUILT_IN_ROBOT)
    assert (built_in.legs, built_in.source, built_in.install) == ("4 x 3", "equipoise", None)
    assert built_in.mass == pytest.approx(12.458)
    assert built_in.leg_length == pytest.approx(0.4)
    for name, row in rows.items():
        assert row.install == CATALOG[name].hint


def test_the_catalogue_agrees_with_the_installed_model_files(quietly):
    for row in CATALOG.values():
        if row.install is None:
            robot = load_robot(row.name)
            assert row.mass == pytest.approx(robot.mass, abs=0.51e-3)
            assert row.leg_length == pytest.approx(robot.leg_length, abs=0.51e-3)
            assert row.legs == f"4 x {len(robot.legs['FL'].joints)}"


def test_an_unknown_name_is_refused_with_the_known_ones():
    with pytest.raises(ModelError) as error:
        load_robot("spot")
    assert str(error.value) == (
        f"no robot is called 'spot' and no such file exists; known names are {', '.join(CATALOG)}; "
        "for others give the URDF or MJCF file, or robot_descriptions:NAME"
    )
    assert error.value.exit_code == 3


@pytest.mark.parametrize(
    ("name", "near"),
    [
        ("unitree_go22", "go2"),
        ("Unitree-B1x", "b1"),
        ("anymal", "anymal_c"),
        ("Unitree-A1", "unitree_a1"),
        ("unitree_a2", "unitree_a1"),
    ],
)
def test_a_misspelt_name_is_answered_with_the_nearest_one(name, near):
    with pytest.raises(ModelError, match=f"did you mean '{near}'"):
        load_robot(name)


@pytest.mark.parametrize("path", ["models/spot", "spot.urdf"])
def test_a_missing_path_is_refused_as_a_file(path):
    with pytest.raises(ModelError, match=f"robot model '{path}' does not exist"):
        load_robot(path)


@pytest.mark.parametrize("text", [quadruped_urdf(), quadruped_mjcf()], ids=["urdf", "mjcf"])
@pytest.mark.parametrize("kind", [str, lambda path: path], ids=["text", "Path"])
def test_a_users_file_is_a_robot(quietly, tmp_path, text, kind):
    path = tmp_path / "mine.xml"
    path.write_text(text, encoding="utf-8")
    robot = load_robot(kind(path), RobotDescription(foot_radius=0.05))
    assert (robot.name, robot.legs["FL"].foot_radius) == ("mine", 0.05)
    assert robot.mass == load_text(tmp_path, text).mass


def test_a_description_applies_to_catalogue_robots():
    assert load_robot(BUILT_IN_ROBOT, RobotDescription(foot_radius=0.05)).legs["RR"].foot_radius == 0.05


# --- the package robot_descriptions


@pytest.fixture
def robot_descriptions(monkeypatch):
    """Replace the package by a stub with one module of the given contents."""

    def install(name, **contents):
        package, description = types.ModuleType("robot_descriptions"), types.ModuleType(f"robot_descriptions.{name}")
        package.__path__ = []
        vars(description).update(contents)
        monkeypatch.setitem(sys.modules, "robot_descriptions", package)
        monkeypatch.setitem(sys.modules, f"robot_descriptions.{name}", description)

    return install


@pytest.mark.parametrize("asked", ["go9", "go9_description"])
@pytest.mark.parametrize("key", ["URDF_PATH", "MJCF_PATH"])
def test_files_of_the_package_robot_descriptions_are_loaded(quietly, robot_descriptions, tmp_path, asked, key):
    path = tmp_path / "robot.xml"
    path.write_text(quadruped_urdf() if key == "URDF_PATH" else quadruped_mjcf(), encoding="utf-8")
    robot_descriptions("go9_description", **{key: str(path)})
    robot = load_robot(f"robot_descriptions:{asked}")
    assert robot.name == asked
    assert robot.mass == pytest.approx(13.6)


def test_without_the_package_robot_descriptions_the_error_names_the_command(monkeypatch):
    def no_package(name):
        raise ModuleNotFoundError(f"No module named {name!r}", name="robot_descriptions")

    monkeypatch.setattr("importlib.import_module", no_package)
    with pytest.raises(MissingDependencyError) as error:
        load_robot("robot_descriptions:go2")
    assert str(error.value) == "robot_descriptions:go2_description needs a package: pip install robot_descriptions"


def test_a_robot_that_robot_descriptions_does_not_have_is_refused(robot_descriptions):
    robot_descriptions("go9_description")
    with pytest.raises(ModelError, match=r"^robot_descriptions has no robot 'spot_description': "):
        load_robot("robot_descriptions:spot")


def test_a_description_without_a_file_is_refused(robot_descriptions):
    robot_descriptions("go9_description")
    with pytest.raises(ModelError) as error:
        load_robot("robot_descriptions:go9")
    assert str(error.value) == "robot_descriptions gives no URDF or MJCF file for 'go9_description'"


def test_a_failed_fetch_is_a_model_error(monkeypatch, robot_descriptions):
    robot_descriptions("go9_description")

    def no_network(name):
        raise OSError("no route to host")

    monkeypatch.setattr("importlib.import_module", no_network)
    with pytest.raises(ModelError) as error:
        load_robot("robot_descriptions:go9")
    assert str(error.value) == (
        "robot_descriptions could not fetch 'go9_description' (is there a network?): no route to host"
    )


def test_the_built_in_robot_has_no_warnings():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        robot = load_robot(BUILT_IN_ROBOT)
    assert robot.source.repairs == ()
    assert audit(robot).stance is not None
