"""Sensor and motor parameters in every format, with the signs that consumers expect, and refused exports."""

import dataclasses
import json
import math
import shutil
import subprocess
import sys

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from exporting import finding, found, make_run, with_joints
from robots import load_text, quadruped_mjcf

from equipoise import export
from equipoise.cli import main
from equipoise.errors import ModelError, NotEstimatedError, SettingsError
from equipoise.exports.formats import FORMATS
from equipoise.result.body import Body
from equipoise.result.findings import Check

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

OWN = sorted(name for name, row in FORMATS.items() if not row.bodies)
HIP, THIGH, CALF = "FL_hip_joint", "FL_thigh_joint", "FL_calf_joint"


@pytest.fixture(scope="module")
def result(a1):
    return with_joints(found(a1))


def values(result, name):
    """Return the estimates by joint."""
    return {joint: getattr(findings, name).value for joint, findings in result.joints.items()}


def python_names(text):
    names = {}
    exec(text, names)
    return names


# --- read as the consumer does


def test_toml_has_values_stds_and_verdicts(result):
    table = tomllib.loads(export(result, "toml", run="runs/a1").text)
    assert table["schema"] == "equipoise.sensors-and-motors/1"
    assert (table["run"], table["model"]["sha256"]) == ("runs/a1", result.model["sha256"])
    zero = table["sensors"]["joint_offset"]
    assert (zero["unit"], zero["meaning"]) == ("rad", "encoder reading less joint position")
    assert zero["value"][CALF] == values(result, "offset")[CALF] == -3.5e-3
    assert (zero["std"][CALF], zero["verdict"][CALF], zero["verdict"][THIGH]) == (3e-4, "identified", "weak")
    assert table["sensors"]["imu_tilt"]["value"] == {"roll": -0.004, "pitch": 0.002, "yaw": 0.007}
    assert table["sensors"]["clock_offset"]["value"] == {"imu": -1.25e-3}
    assert table["motors"]["delay"]["value"] == values(result, "delay")


def test_json_and_yaml_hold_them_with_or_without_the_bodies(result):
    yaml = pytest.importorskip("yaml")
    whole = yaml.safe_load(export(result, "yaml", parameters="all").text)
    alone = json.loads(export(result, "json", parameters="motors").text)
    assert whole["composite"]["mass"] == result.composite.mass.value
    assert whole["motors"] == alone["motors"] == tomllib.loads(export(result, "toml").text)["motors"]
    assert not {"composite", "base", "sensors"} & set(alone)


def test_yaml_of_ros_of_unitree_and_of_joint_offsets(result, a1):
    yaml = pytest.importorskip("yaml")
    parameters = yaml.safe_load(export(result, "ros2").text)["/**"]["ros__parameters"]["equipoise"]
    assert parameters["armature"] == values(result, "armature")
    assert parameters["joint_offset"][CALF] == -3.5e-3
    lists = yaml.safe_load(export(result, "unitree-yaml").text)
    assert lists["joint_names"][:4] == ["FR_hip_joint", "FR_thigh_joint", "FR_calf_joint", HIP]
    assert dict(zip(lists["joint_names"], lists["armature"], strict=True)) == values(result, "armature")
    offsets = dict(zip(lists["joint_names"], lists["joint_offset"], strict=True))
    assert (offsets[HIP], offsets[CALF]) == (0.0, -3.5e-3)  # the hip's is not identified
    assert lists["imu_tilt"] == [-0.004, 0.002, 0.007]
    zeros = yaml.safe_load(export(result, "joint-offsets").text)
    assert zeros == {joint: zero for joint, zero in values(result, "offset").items() if joint != HIP}
    with pytest.raises(SettingsError, match="name the run folder"):
        export(dataclasses.replace(result, robot_model=None), "unitree-yaml")


def test_the_c_header_compiles_as_c_and_as_cpp(result, tmp_path):
    compiler = shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        pytest.skip("there is no C compiler")
    (tmp_path / "found.h").write_text(export(result, "c-header").text, encoding="utf-8")
    prints = "".join(
        f'for (int i = 0; i < {size}; ++i) printf("%.17g ", equipoise_{name}[i]); puts("");'
        for name, size in (("joint_offset", "EQUIPOISE_JOINTS"), ("relative_gain", "EQUIPOISE_JOINTS"), ("imu_tilt", 3))
    )
    code = f'#include <stdio.h>\n#include "found.h"\nint main(void) {{ puts(equipoise_joint_names[1]); {prints} return 0; }}'
    for language in ("c", "c++"):
        (tmp_path / "check").write_text(code, encoding="utf-8")
        command = [compiler, "-Wall", "-Wno-unused", "-Werror", "-x", language, "check", "-o", "program"]
        subprocess.run(command, cwd=tmp_path, check=True)
        name, zeros, gains, tilt = subprocess.check_output(tmp_path / "program", text=True).splitlines()
        assert name == THIGH
        assert [float(word) for word in zeros.split()] == [0.0, *list(values(result, "offset").values())[1:]]
        assert [float(word) for word in gains.split()] == [
            0.0,
            0.0,
            *list(values(result, "relative_gain").values())[2:],
        ]
        assert [float(word) for word in tilt.split()] == [-0.004, 0.002, 0.007]


def test_holosoma_adds_the_offsets_to_its_commands(result):
    names = python_names(export(result, "holosoma").text)
    offsets = names["joint_offsets_deg"]((CALF, "waist", HIP))
    assert offsets == (pytest.approx(math.degrees(-3.5e-3)), 0.0, 0.0)


def test_mjlab_adds_the_bias_to_the_position_and_counts_delays_in_steps(result):
    names = python_names(export(result, "mjlab", parameters="sensors,motors").text)
    assert "PSEUDO_INERTIA" not in names
    assert set(names["ENCODER_BIAS"]) == set(result.joint_position) - {HIP}
    assert names["ENCODER_BIAS"][CALF] == pytest.approx((-3.5e-3 - 1.96 * 3e-4, -3.5e-3 + 1.96 * 3e-4))
    row = names["actuators"](0.002)[2]
    assert row == {
        "target_names_expr": (CALF,), "armature": 0.0102, "frictionloss": 0.32, "viscous_damping": pytest.approx(0.052),
        "delay_min_lag": 2, "delay_max_lag": 2,
    }  # fmt: skip
    assert names["actuators"](0.0005)[11]["delay_max_lag"] == 8  # 4.15 ms


def test_isaaclab_takes_dictionaries_by_joint_and_one_delay(result):
    names = python_names(export(result, "isaaclab", parameters="all").text)
    assert names["JOINT_OFFSET"][CALF] == pytest.approx((-3.5e-3 - 1.96 * 3e-4, -3.5e-3 + 1.96 * 3e-4))
    fields = names["actuator"](0.001)
    assert fields["friction"] == fields["dynamic_friction"] == values(result, "coulomb_friction")
    assert fields["viscous_friction"] == values(result, "viscous_friction")
    assert fields["armature"] == values(result, "armature")
    assert (fields["min_delay"], fields["max_delay"]) == (4, 4)
    assert names["MASS"]["operation"] == "scale"


MJCF = quadruped_mjcf().replace("><", ">\n<")


def dofs(text, result):
    """Return armature, friction loss and damping by joint, as MuJoCo compiles them."""
    model = mujoco.MjModel.from_xml_string(text)
    at = [model.jnt_dofadr[model.joint(name).id] for name in result.joint_position]
    damping = np.reshape(model.dof_damping, (model.nv, -1))[:, 0]  # MuJoCo 4: three numbers a joint
    return model.dof_armature[at], model.dof_frictionloss[at], damping[at]


def test_mujoco_reads_joints_and_base(tmp_path):
    robot = load_text(tmp_path, MJCF, name="robot.xml")
    result = with_joints(found(robot))
    alone, both = (export(result, "mjcf", parameters=what).text for what in ("motors", "base,motors"))
    wanted = [list(values(result, name).values()) for name in ("armature", "coulomb_friction", "viscous_friction")]
    np.testing.assert_array_equal(dofs(alone, result), wanted)
    np.testing.assert_array_equal(dofs(both, result), wanted)
    trunk = lambda text: mujoco.MjModel.from_xml_string(text).body_mass[1]  # noqa: E731
    assert trunk(alone) == trunk(MJCF) < trunk(both)
    assert trunk(both) == trunk(export(result, "mjcf").text)
    without_nameless = MJCF.replace(f'name="{next(iter(result.joint_position))}"', "")
    nameless = with_joints(found(load_text(tmp_path, without_nameless, name="nameless.xml")))
    with pytest.raises(ModelError, match="with a name for each joint"):
        export(nameless, "mjcf", parameters="motors")


def test_pinocchio_reads_joints(result, tmp_path):
    text = export(result, "urdf", parameters="motors").text
    model, before = pin.buildModelFromXML(text), pin.buildModelFromUrdf(str(result.robot_model.source.path))
    at = [model.joints[model.getJointId(name)].idx_v for name in result.joint_position]
    np.testing.assert_array_equal(model.damping[at], list(values(result, "viscous_friction").values()))
    friction = model.friction if hasattr(model, "friction") else model.upperDryFrictionLimit
    np.testing.assert_array_equal(friction[at], list(values(result, "coulomb_friction").values()))
    assert all(a == b for a, b in zip(model.inertias, before.inertias, strict=True))
    again = tmp_path / "again.urdf"
    again.write_text(text, encoding="utf-8")
    assert export(result, "urdf", parameters="motors", file=again).text.count("<dynamics ") == 12  # edited, not added


# --- what is written, and what is not


def test_by_default_files_that_hold_the_base_hold_it_alone(result, a1):
    for name in ("urdf", "json", "mjlab"):
        assert export(result, name).content == export(found(a1), name, parameters="base").content


def test_values_not_identified_are_left_out_with_a_note(result):
    out = export(result, "toml")
    assert out.notes == (
        "not identified, so not written (0 where a format lists every joint): "
        f"joint_offset ({HIP}), relative_gain ({HIP} {THIGH})",
        f"weakly identified: joint_offset ({THIGH})",
    )
    assert HIP not in tomllib.loads(out.text)["sensors"]["joint_offset"]["value"]
    forced = export(result, "toml", force=True)
    assert forced.notes[0] == f"FORCED: not identified: joint_offset ({HIP}), relative_gain ({HIP} {THIGH})"
    assert tomllib.loads(forced.text)["sensors"]["joint_offset"]["value"][HIP] == -5.5e-3


def test_priors_of_the_run_determine_the_verdicts(result):
    sure = dataclasses.replace(result, settings={"priors": {"joint_offset": 5e-4}})
    assert set(tomllib.loads(export(sure, "toml").text)["sensors"]) == {"imu_tilt", "clock_offset"}


def test_a_result_without_identified_values_is_refused(result):
    vague = dataclasses.replace(result, sensors=(finding(f"{HIP} offset", 1e-3, 4e-3),))
    with pytest.raises(NotEstimatedError) as error:
        export(vague, "ros2")
    assert str(error.value) == (
        "not identified by this run: joint_offset (all); calibrate longer (--duration), or write them anyway "
        "with --force"
    )
    assert f"{HIP}: 0.001" in export(vague, "ros2", force=True).text
    tilted = dataclasses.replace(result, sensors=result.sensors[:3])
    with pytest.raises(NotEstimatedError, match="no joint offset is identified"):
        export(tilted, "holosoma")


@pytest.mark.parametrize("name", ["urdf", *OWN])
def test_a_result_with_a_failed_check_is_refused_unless_forced(name, result):
    doubtful = dataclasses.replace(result, checks=(Check("stance motion residuals", False, "they slid"),))
    what = "motors" if name == "urdf" else None
    with pytest.raises(
        NotEstimatedError, match="the result is doubtful: check failed: stance motion residuals: they slid"
    ):
        export(doubtful, name, parameters=what)
    assert (
        "check failed: stance motion residuals: they slid" in export(doubtful, name, parameters=what, force=True).text
    )


@pytest.mark.parametrize("name", ["urdf", "json"])
def test_a_run_of_motors_alone_exports_them(result, name):
    alone = dataclasses.replace(result, sensors=(), composite=Body.partial(result.nominal.composite))
    assert export(alone, name).parts == ("motors",)
    assert export(result, name).parts == ("base",)


def test_a_run_without_motors_gives_the_shared_values(result):
    common = dataclasses.replace(result, motors={}, sensors=(finding("Coulomb friction of the joints", 0.3, 0.02),))
    motors = tomllib.loads(export(common, "toml").text)["motors"]
    assert motors["coulomb_friction"]["value"] == dict.fromkeys(result.joint_position, 0.3)
    assert set(motors) == {"coulomb_friction"}
    with pytest.raises(NotEstimatedError) as error:
        export(dataclasses.replace(result, motors={}), "urdf", parameters="motors")
    assert str(error.value) == "this run did not estimate motors; calibrate with --parameters base,motors"


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        (
            "urdf",
            {"parameters": "base,legs", "payload_link": True},
            "--add-payload-link does not change the model's links",
        ),
        (
            "ros2",
            {"parameters": "legs"},
            "--parameters legs: ros2 does not hold legs, only sensors, motors; urdf, mjcf, yaml",
        ),
        (
            "urdf",
            {"parameters": "motor"},
            "--parameters is 'motor'; did you mean 'motors'? it must be base, sensors, motors, legs, several",
        ),
        (
            "urdf",
            {"parameters": "sensors"},
            "--parameters sensors: urdf does not hold sensors, only base, motors, legs; mjlab, isaaclab, yaml",
        ),
        (
            "toml",
            {"parameters": "base"},
            "--parameters base: toml does not hold base, only sensors, motors, legs; urdf, mjcf, sdf",
        ),
        ("urdf", {"parameters": "motors", "payload_link": True}, "need the base, which --parameters motors leaves out"),
    ],
)
def test_parts_that_a_format_does_not_hold_are_refused(name, options, message, result):
    with pytest.raises(SettingsError) as error:
        export(result, name, **options)
    assert message in str(error.value)


@pytest.mark.parametrize("name", ["a\nimport os", "x\\", '"] = 1', "--><evil/><!--", "a\u2028b\x85c", "no", "1: 2"])
def test_names_cannot_inject_code(result, name):
    hostile = dataclasses.replace(
        result,
        robot=name,
        joint_position={name: 0.0},
        motors={name: result.motors[CALF]},
        sensors=(finding(f"{name} offset", 1e-3, 1e-5),),
        robot_model=None,
    )
    yaml = pytest.importorskip("yaml")
    assert tomllib.loads(export(hostile, "toml").text)["motors"]["armature"]["value"] == {name: 0.0102}
    parameters = yaml.safe_load(export(hostile, "ros2").text)["/**"]["ros__parameters"]["equipoise"]
    assert parameters["armature"] == {name: 0.0102}
    assert python_names(export(hostile, "mjlab", parameters="all").text)["ARMATURE"] == {name: 0.0102}
    header = export(hostile, "c-header").text
    assert all(" " <= letter <= "~" or letter == "\n" for letter in header.split("equipoise_joint_names")[1])
    assert yaml.safe_load(export(hostile, "joint-offsets").text) == {name: 1e-3}


def test_the_command_line_names_the_omitted_values(a1, tmp_path, capsys):
    make_run(tmp_path / "run", a1)
    assert main(["export", str(tmp_path / "run"), "--to", "toml", "--parameters", "motors"]) == 0
    assert (
        "not identified, so not written (0 where a format lists every joint): relative_gain" in capsys.readouterr().out
    )
    table = tomllib.loads((tmp_path / "run" / "export" / "motors.toml").read_text(encoding="utf-8"))
    assert set(table) & {"sensors", "motors"} == {"motors"}
    assert main(["export", str(tmp_path / "run"), "--to", "toml", "--parameters", "legs"]) == 8
    assert "this run did not estimate legs; calibrate with --parameters base,legs" in capsys.readouterr().err
