"""JSON form of a result, its errors, and the model with the estimated base."""

import dataclasses
import json

import numpy as np
import pinocchio as pin
import pytest
from robots import load_text, quadruped_urdf

from equipoise import (
    Calibration,
    ComSearchSettings,
    ExcitationSettings,
    InertialParameters,
    PaperMethod,
    RobotDescription,
    calibrate,
    nominal_stance,
    simulate,
)
from equipoise.errors import NotEstimatedError, OutputError, RecordingError
from equipoise.json_form import from_json, to_json
from equipoise.result.body import Body
from equipoise.result.legend import left_out_message, lifts_message
from equipoise.robot.inertial import RobotInertia, nominal_inertia

SETTINGS = PaperMethod(com_search=ComSearchSettings(tolerance=0.02), excitation=ExcitationSettings(duration=1.0))
BASE = InertialParameters(
    6.2, np.array([0.02, -0.003, 0.03]), np.array([[0.03, 1e-3, 2e-3], [1e-3, 0.07, -1e-3], [2e-3, -1e-3, 0.08]])
)


@pytest.fixture(scope="module")
def without_truth(a1):
    with simulate(a1, "ideal") as simulation:
        return calibrate(simulation.platform, a1, SETTINGS).with_provenance(seed=0), simulation.truth


@pytest.fixture(scope="module")
def calibration(without_truth):
    return without_truth[0].with_truth(without_truth[1])


@pytest.fixture
def path(tmp_path):
    return tmp_path / "calibration.json"


# --- JSON


def test_json_round_trip(calibration, path):
    calibration.save(path)
    assert Calibration.load(path).to_dict() == calibration.to_dict()
    assert Calibration.load(path).to_json() == calibration.to_json() == path.read_text()


def test_a_result_without_a_truth_is_kept_too(without_truth, path):
    without_truth[0].save(path)
    table = json.loads(path.read_text())
    assert table["truth"] is table["errors"] is None
    assert Calibration.load(path).to_dict() == table


def test_the_json_keys_are_those_that_others_rely_on(calibration):
    table = json.loads(calibration.to_json())
    assert list(table) == [
        "schema", "robot", "method", "model", "stance", "composite", "base", "stance_effective",
        "sensors", "motors", "links", "checks", "uncertainty_budget", "held_out", "mass_comparison", "excitations",
        "support_lines", "trials",
        "settings", "provenance", "warnings", "assumptions", "verdicts", "nominal", "truth", "errors",
    ]  # fmt: skip
    assert table["schema"] == "equipoise.calibration/1"
    assert table["robot"] == "unitree_a1"
    assert table["method"] == "paper"
    assert list(table["model"]) == ["format", "sha256", "base_link", "forward", "imu"]
    body = ["mass", "com_in_base", "inertia"]
    for name in ("composite", "base"):
        assert list(table[name]) == [*body, "uncertainty"]
        assert list(table["errors"][name]) == body
    for name in ("nominal", "truth"):
        assert list(table[name]) == ["composite", "base", "stance_effective"]
        assert all(list(each) == body for each in table[name].values())
    assert list(table["excitations"]) == ["roll", "pitch", "yaw"]
    assert list(table["excitations"]["yaw"]) == ["moment", "damping", "frequency", "amplitude", "note"]
    assert list(table["support_lines"]) == ["FL_RR", "FR_RL"]
    assert list(table["support_lines"]["FL_RR"]) == ["offset", "lower", "upper", "point", "normal"]
    trial = ["kind", "about", "offset", "lift_height", "tilt", "verdict", "duration", "normalized_residual", "note"]
    assert all(list(each) == trial for each in table["trials"])


def test_the_stance_is_by_joint_name(calibration, a1):
    stored = json.loads(calibration.to_json())["stance"]["joint_position"]
    assert list(stored) == list(a1.joint_names)
    assert list(stored.values()) == nominal_stance(a1).joint_position.tolist()


def test_parameters_without_estimate_are_null(calibration):
    table = json.loads(calibration.to_json())
    x, y, z = table["composite"]["com_in_base"]
    assert isinstance(x, float)
    assert isinstance(y, float)
    assert z is table["composite"]["mass"] is table["composite"]["inertia"] is None
    assert table["base"] == {"mass": None, "com_in_base": [None, None, None], "inertia": None, "uncertainty": None}
    assert table["composite"]["uncertainty"] is None
    assert table["errors"]["composite"]["com_in_base"][2] is None
    assert table["errors"]["composite"]["inertia"] is None


def test_the_json_is_strict(calibration):
    json.dumps(calibration.to_dict(), allow_nan=False)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is an empty file; name the run folder of a calibration, or its calibration.json"),
        (b"{", "is not valid JSON"),
        (b"\xff\xfe\x00", "is a binary file; name"),
        (b"[]", "is a JSON file of another kind; name the run folder of a calibration, or its calibration.json"),
        (b"{}", "is a JSON file of another kind"),
        (
            b'{"schema": "equipoise.calibration/3"}',
            "is 'equipoise.calibration/3'; this version reads 'equipoise.calibration/1': it was made by an earlier version; "
            "record or estimate again$",
        ),
        (b'{"schema": "equipoise.calibration/1"}', "is damaged: KeyError"),
    ],
)
def test_another_file_is_no_result(path, content, message):
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=rf"'.*calibration.json' {message}"):
        Calibration.load(path)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("excitations", []), ("excitations", {"roll": {"moment": 1.0}}), ("excitations", {"roll": {"colour": 1}}), ("trials",
        [{}]), ("trials", None), ("composite", None), ("composite", {"mass": 1, "com_in_base": [1, 2], "inertia": None}),
        ("support_lines", {"FL_RR": 3}), ("support_lines", [1]), ("stance", {}), ("stance", []), ("truth", {}),
        ("nominal", None), ("nominal", {"composite": []}), ("warnings", None),
    ],
)  # fmt: skip
def test_a_damaged_result_raises(calibration, path, key, value):
    path.write_text(json.dumps({**calibration.to_dict(), key: value}))
    with pytest.raises(RecordingError, match=r"the result '.*calibration.json' is damaged: "):
        Calibration.load(path)


@pytest.mark.parametrize("key", ["robot", "method", "model", "settings", "provenance", "base"])
def test_a_result_that_lacks_a_key_is_damaged(calibration, path, key):
    path.write_text(json.dumps({name: value for name, value in calibration.to_dict().items() if name != key}))
    with pytest.raises(RecordingError, match=f"is damaged: KeyError\\('{key}'\\)"):
        Calibration.load(path)


def test_a_place_that_cannot_be_written_or_read_is_named(calibration, tmp_path):
    with pytest.raises(OutputError, match=r"cannot write '.*missing/calibration.json': No such file or directory"):
        calibration.save(tmp_path / "missing" / "calibration.json")
    with pytest.raises(
        RecordingError, match=r"'.*missing.json' does not exist; name the run folder of a calibration, or its"
    ):
        Calibration.load(tmp_path / "missing.json")


def test_joint_estimates_are_by_joint_name(bayesian_run):
    result = bayesian_run.result
    found = {finding.name: finding for finding in result.sensors}
    offset, gain = result.joints["FL_calf_joint"].offset, result.joints["FL_calf_joint"].torque_gain
    assert (offset.value, offset.std) == (found["FL_calf_joint offset"].value, found["FL_calf_joint offset"].std)
    assert (offset.unit, offset.half_width) == ("rad", found["FL_calf_joint offset"].half_width)
    assert gain.value == found["FL_calf_joint torque gain"].value
    few = dataclasses.replace(result, sensors=())
    assert few.joints["RR_hip_joint"].offset.value is None
    assert list(few.joints) == list(few.joint_position)


# --- against the truth


def test_errors_are_estimate_less_truth(calibration, without_truth):
    _, truth = without_truth
    errors = calibration.to_dict()["errors"]
    com = calibration.composite.com_in_base
    assert com.errors[:2] == pytest.approx(com.values[:2] - truth.composite.com[:2])
    assert errors["composite"]["com_in_base"] == [com.x.error, com.y.error, None]
    for index, axis in enumerate(("roll", "pitch", "yaw")):
        moment, errors_of_axis = calibration.excitations[axis].moment, errors["moments_relative"][axis]
        assert calibration.moments[axis].value == moment
        assert calibration.moments[axis].error == moment - truth.stance_effective.inertia[index, index]
        assert calibration.moments[axis].model == calibration.nominal.stance_effective.inertia[index, index]
        assert errors_of_axis == pytest.approx({
            "against_stance_effective": moment / truth.stance_effective.inertia[index, index] - 1,
            "against_composite": moment / truth.composite.inertia[index, index] - 1,
        })  # fmt: skip


def test_an_axis_without_an_estimate_has_no_error(calibration):
    skipped = dataclasses.replace(calibration.excitations["yaw"], moment=None, damping=None, note="skipped")
    partial = dataclasses.replace(calibration, excitations={**calibration.excitations, "yaw": skipped})
    assert list(partial.moment_errors()) == list(partial.moments) == ["roll", "pitch"]


def test_there_are_no_errors_without_a_truth(without_truth):
    assert without_truth[0].to_dict()["errors"] is None
    assert without_truth[0].moment_errors() == {}


def test_joining_facts_leaves_the_result_as_it_was(without_truth):
    result, truth = without_truth
    joined = result.with_truth(truth).with_provenance(payload=[1.0])
    assert result.truth is None
    assert "payload" not in result.provenance
    assert joined.provenance == {**result.provenance, "payload": [1.0]}


def test_the_three_bodies_go_there_and_back(a1):
    bodies = nominal_inertia(a1, nominal_stance(a1).joint_position)
    again = from_json(RobotInertia, json.loads(json.dumps(to_json(bodies))))
    for field in dataclasses.fields(bodies):
        assert np.array_equal(getattr(again, field.name).inertia, getattr(bodies, field.name).inertia)


# --- the model with what was found


def test_the_papers_method_gives_no_model(calibration):
    with pytest.raises(NotEstimatedError, match=r"this calibration does not estimate mass, inertia, com_in_base\.x"):
        calibration.to_pinocchio()


def test_a_result_from_json_has_no_model_at_hand(calibration, path):
    calibration.save(path)
    with pytest.raises(NotEstimatedError, match="the robot model is not available: open the run folder instead"):
        Calibration.load(path).to_pinocchio()


def test_to_pinocchio_replaces_the_base_inertia(calibration, a1):
    before = [pin.Inertia(inertia) for inertia in a1.full_pinocchio.inertias]
    model = dataclasses.replace(calibration, base=Body.complete(BASE)).to_pinocchio()
    assert model.inertias[1].isApprox(BASE.to_pinocchio())
    assert list(model.names) == list(a1.full_pinocchio.names)
    for after, unchanged in list(zip(model.inertias, before, strict=True))[2:]:
        assert after == unchanged
    assert all(now == then for now, then in zip(a1.full_pinocchio.inertias, before, strict=True))


def test_the_base_found_includes_the_arm_that_was_held_and_the_model_has_both(calibration, tmp_path):
    held = {"arm_0": 0.7, "arm_1": -0.4}
    robot = load_text(tmp_path, quadruped_urdf(arm_joints=2), RobotDescription(locked_joints=held))
    result = dataclasses.replace(calibration, robot_model=robot, base=Body.complete(BASE))
    model = result.to_pinocchio()
    assert list(model.names) == list(robot.full_pinocchio.names)
    for name in (*held, "FL_0"):
        joint = model.getJointId(name)
        assert model.inertias[joint] == robot.full_pinocchio.inertias[joint]
    configuration = pin.neutral(model)
    for name, position in held.items():
        configuration[model.joints[model.getJointId(name)].idx_q] = position
    locked = pin.buildReducedModel(model, [model.getJointId(name) for name in held], configuration)
    assert locked.inertias[1].isApprox(BASE.to_pinocchio(), 1e-9)


# --- motions


def test_motions_that_were_not_used_are_counted_with_their_reasons(calibration):
    lift = next(trial for trial in calibration.trials if trial.kind == "lift")
    short, far = (dataclasses.replace(lift, note=note) for note in ("up for only 0.1 s", "does not fit"))

    def messages(*trials):
        result = dataclasses.replace(calibration, trials=trials)
        return lifts_message(result), left_out_message(result)

    assert messages(lift, lift) == ("2 lifts", "")
    assert messages(lift, short, far, short) == (
        "1 of 4 lifts used", "Not used: 2 lifts (up for only 0.1 s), 1 lift (does not fit)."
    )  # fmt: skip
    others = [dataclasses.replace(lift, note=str(number)) for number in range(5)]
    assert messages(lift, *others)[1].endswith("1 lift (2), 2 more, see the report's table of motions.")
