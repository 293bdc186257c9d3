"""Difference of the measured base from that of another model file."""

import dataclasses
import json

import numpy as np
import pytest
import yaml
from commands import fails
from exporting import added_to, found, make_run
from robots import FOUR_LEGS, HIPS, load_text, quadruped_mjcf, quadruped_urdf

from equipoise import RobotDescription, export
from equipoise.cli import main
from equipoise.errors import ModelError, SettingsError
from equipoise.exports.randomisation import ENTRIES, components_of, drawn_bases, pseudo_inertias
from equipoise.exports.relative import load_reference
from equipoise.result.body import Body
from equipoise.robot.inertial import COMPONENTS, InertialParameters

ORIGIN = (
    "mass",
    *(f"moment_{axis}" for axis in "xyz"),
    *(f"I{axes}_origin" for axes in ("xx", "xy", "yy", "xz", "yz", "zz")),
)
ROTOR = (
    '<link name="{0}_rotor"><inertial><mass value="0.1"/>'
    '<inertia ixx="1e-4" iyy="5e-5" izz="5e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    '<joint name="{0}_fix" type="fixed"><parent link="{1}"/><child link="{0}_rotor"/><origin xyz="{2}"/></joint>'
)

pytestmark = pytest.mark.filterwarnings("ignore::equipoise.errors.ModelWarning")


def rotors(in_legs):
    """Return rotors on the axes of the four hips, fixed to the trunk or to the upper leg links."""
    hips = {leg: f"{x} {y} 0" for leg, (x, y) in HIPS.items() if leg in FOUR_LEGS}
    return "".join(
        ROTOR.format(leg, f"{leg}_link_0" if in_legs else "trunk", "0 0 0" if in_legs else hip)
        for leg, hip in hips.items()
    )


def relative(result, folder, text, name="policy.urdf"):
    """Return the difference from a file with this text, as JSON."""
    (folder / name).write_text(text)
    reference = load_reference(str(folder / name), result)
    return json.loads(export(result, "json", relative_to=reference).text)


def column(table, kind, names, key="difference"):
    return np.array([table[kind][name][key] for name in names])


def upper(entries):
    alpha, d1, d2, d3, s12, s13, s23, t1, t2, t3 = entries
    rows = [[np.exp(d1), s12, s13, t1], [0, np.exp(d2), s23, t2], [0, 0, np.exp(d3), t3], [0, 0, 0, 1]]
    return np.exp(alpha) * np.array(rows)


@pytest.fixture
def robot(tmp_path):
    return load_text(tmp_path, quadruped_urdf(extra=rotors(in_legs=False)), name="robot.urdf")


@pytest.fixture
def result(robot):
    return found(robot)


def test_the_difference_from_the_same_file_is_the_payload(result, robot, tmp_path):
    table = relative(result, tmp_path, quadruped_urdf(extra=rotors(in_legs=False)))
    added, body = added_to(robot), result.base_for_model_legs
    np.testing.assert_allclose(column(table, "base", ORIGIN), added.vector, atol=1e-12)
    np.testing.assert_allclose(column(table, "base", ORIGIN, "run"), body, atol=1e-12)
    com = InertialParameters.from_vector(body).com
    np.testing.assert_allclose(column(table, "base", ("com_x", "com_y", "com_z"), "run"), com, atol=1e-12)
    assert table["links"]["run"] == table["links"]["model"]
    assert not any(table["legs_run_minus_model"].values())


def test_rotors_that_one_file_counts_in_the_trunk_and_the_other_in_the_legs_are_no_difference(result, robot, tmp_path):
    table = relative(result, tmp_path, quadruped_urdf(extra=rotors(in_legs=True)))
    np.testing.assert_allclose(column(table, "base", ORIGIN), added_to(robot).vector, atol=1e-12)
    assert table["base"]["mass"]["model"] == pytest.approx(6.0)
    assert set(table["links"]["run"]["base"]) - set(table["links"]["model"]["base"]) == {
        f"{leg}_rotor" for leg in ("FL", "FR", "RL", "RR")
    }
    assert table["links"]["model"]["legs"]["FL_rotor"] == pytest.approx(0.1)
    assert table["legs_run_minus_model"]["mass"] == pytest.approx(-0.4)
    assert any("0.400 kg heavier" in note for note in table["notes"])


def test_rotors_that_the_other_file_omits_are_a_difference_with_a_note(result, robot, tmp_path):
    table = relative(result, tmp_path, quadruped_urdf())
    assert table["base"]["mass"]["difference"] == pytest.approx(added_to(robot).mass + 0.4)
    assert not any("legs of" in note for note in table["notes"])


def test_log_cholesky_parameters_make_both_bodies(result, tmp_path):
    table = relative(result, tmp_path, quadruped_urdf(trunk_mass=5.0))
    bodies = {}
    for side in ("model", "run"):
        (bodies[side],) = pseudo_inertias(column(table, "base", ORIGIN, side)[None])
        root = upper(column(table, "log_cholesky", ENTRIES, side))
        np.testing.assert_allclose(root @ root.T, bodies[side], atol=1e-12)
    stretch = upper(column(table, "stretch", ENTRIES))
    np.testing.assert_allclose(stretch @ bodies["model"] @ stretch.T, bodies["run"], atol=1e-12)
    difference = column(table, "log_cholesky", ENTRIES, "run") - column(table, "log_cholesky", ENTRIES, "model")
    np.testing.assert_allclose(column(table, "log_cholesky", ENTRIES), difference, atol=1e-12)


def test_intervals_are_those_of_bodies_drawn_from_the_posterior(result, tmp_path):
    small = Body.complete(
        result.composite.parameters(), result.composite.covariance / 25, None, result.nominal.composite
    )
    result = dataclasses.replace(result, composite=small)  # hardly any drawn body is not physical
    table = relative(result, tmp_path, quadruped_urdf(extra=rotors(in_legs=False)))
    base, composite = InertialParameters.from_vector(result.base_for_model_legs), result.composite
    drawn = drawn_bases(base, composite.parameters(), composite.covariance, seed=5)
    np.testing.assert_allclose(column(table, "base", COMPONENTS, "std"), components_of(drawn).std(axis=0), rtol=0.05)
    order = table["covariance"]["order"]
    std = np.sqrt(np.diag(table["covariance"]["values"]))
    np.testing.assert_allclose(column(table, "base", order, "std"), std, rtol=1e-9)
    alpha, mass = table["log_cholesky"]["alpha"], table["base"]["mass"]  # m = exp(2 alpha)
    assert alpha["std"] == pytest.approx(mass["std"] / mass["run"] / 2, rel=0.05)
    assert mass["significant"]
    assert mass["lower"] == pytest.approx(mass["difference"] - 1.96 * mass["std"])


def test_a_file_with_y_forward_gets_its_own_axes(result, robot, tmp_path):
    turned = tmp_path / "turned"
    turned.mkdir()
    ahead = load_text(turned, quadruped_urdf(), RobotDescription(forward="+y"), name="robot.urdf")
    estimate = found(ahead)
    table = relative(estimate, tmp_path, quadruped_urdf())
    x, y, z = added_to(ahead).vector[1:4]
    np.testing.assert_allclose(column(table, "base", ORIGIN[1:4]), [-y, x, z], atol=1e-12)
    assert table["relative_to"]["base_link"] == "trunk"


def test_an_mjcf_of_the_same_robot_has_the_same_difference(tmp_path):
    robot = load_text(tmp_path, quadruped_urdf(), name="robot.urdf")
    table = relative(found(robot), tmp_path, quadruped_mjcf(), "policy.xml")
    np.testing.assert_allclose(column(table, "base", ORIGIN), added_to(robot).vector, atol=1e-6)


def test_an_arm_that_the_policy_lacked_is_a_difference(tmp_path):
    robot = load_text(tmp_path, quadruped_urdf(arm_joints=2), name="robot.urdf")
    table = relative(found(robot), tmp_path, quadruped_urdf())
    arm = robot.mass - table["base"]["mass"]["model"] - sum(table["links"]["model"]["legs"].values())
    assert arm > 0.1
    assert table["base"]["mass"]["difference"] == pytest.approx(added_to(robot).mass + arm)
    assert "arm_link_1" in table["links"]["run"]["base"]
    assert "arm_link_1" in table["about"]


def test_ros2_has_the_numbers_of_the_json(result, tmp_path):
    (tmp_path / "policy.urdf").write_text(quadruped_urdf())
    reference = load_reference(str(tmp_path / "policy.urdf"), result)
    written = export(result, "ros2", relative_to=reference)
    values = yaml.safe_load(written.text)["/**"]["ros__parameters"]["equipoise"]
    table = json.loads(export(result, "json", relative_to=reference).text)
    for side in ("model", "run", "difference", "std"):
        for kind in ("base", "log_cholesky", "stretch"):
            assert values[side][kind] == {name: row[side] for name, row in table[kind].items()}
    assert written.file_name == "relative_ros2.yaml"
    assert written.header[1].startswith("written of the base: the robot's minus that of policy.urdf: mass +")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (quadruped_urdf(joint_name=lambda leg, joint: f"{leg}_j{joint}"), "only the run has FL_0, FL_1"),
        (quadruped_urdf(joints_per_leg=2), "only the run has FL_2, FR_2"),
    ],
)
def test_other_joints_and_frames_are_refused(text, message, result, tmp_path):
    with pytest.raises(SettingsError, match=message):
        relative(result, tmp_path, text)


def test_a_base_frame_elsewhere_is_refused_with_its_shift(tmp_path, result):
    far = quadruped_urdf(trunk="low", world=False).replace('<origin xyz="0.2 ', '<origin xyz="0.21 ')
    with pytest.raises(SettingsError, match=r"up to 10\.0 mm from those of the run's model"):
        relative(result, tmp_path, far)


def test_a_result_without_its_model_and_unknown_models_are_refused(result):
    with pytest.raises(SettingsError, match=r"a calibration\.json alone has no model file"):
        load_reference("unitree_a1", dataclasses.replace(result, robot_model=None))
    with pytest.raises(ModelError, match="no robot is called 'unitree_a7'"):
        load_reference("unitree_a7", result)


def test_only_json_and_ros2_hold_it(result, robot):
    with pytest.raises(SettingsError, match="--relative-to writes json and ros2, not 'urdf'"):
        export(result, "urdf", relative_to=robot)
    with pytest.raises(SettingsError, match="edits no file"):
        export(result, "json", relative_to=robot, file="a.urdf")


def test_the_command_writes_both_files(tmp_path, robot, capsys):
    run, policy = tmp_path / "run", tmp_path / "policy.urdf"
    make_run(run, robot)
    policy.write_text(quadruped_urdf(extra=rotors(in_legs=True)))
    command = ("export", str(run), "--relative-to", str(policy))
    assert main([*command]) == 0
    printed = capsys.readouterr().out
    assert printed.count("written of the base: the robot's minus that of policy.urdf: mass +") == 1
    for row in ("json  relative.json: difference of the base", "ros2  relative_ros2.yaml: difference of the base"):
        assert row in printed
    assert {path.name for path in (run / "export").iterdir()} == {"relative.json", "relative_ros2.yaml"}
    assert "leave out --all" in fails(capsys, 2, *command, "--all")
    assert "writes several files; leave out --to, --file" in fails(capsys, 2, *command, "--samples", "3")
    assert "no run is given" in fails(capsys, 2, "export", "--relative-to", str(policy))
