"""Joints of logs by their names."""

import itertools
import re

import pytest

from equipoise import load_robot
from equipoise.errors import MissingDependencyError, RecordingError, SettingsError
from equipoise.logs.joint_names import map_by_order, map_joints, read_joint_map
from equipoise.robot.catalog import CATALOG

ORDER = ("RR", "FR", "RL", "FL")
LONG = {"FL": "front_left", "FR": "front_right", "RL": "rear_left", "RR": "rear_right"}
HIND = {"FL": "lf", "FR": "rf", "RL": "lh", "RR": "rh"}
UNITREE = ("hip", "thigh", "calf")


def names(form):
    """A log's joints in an order of its own, by what makes a name of leg and place."""
    return [form(leg, place) for leg in ORDER for place in range(3)]


def columns(robot):
    """Return the expected indices of the joints of `names`, in the robot's order."""
    where = {
        joint: 3 * ORDER.index(leg.name) + place
        for leg in robot.legs.values()
        for place, joint in enumerate(leg.joint_names)
    }
    return [where[joint] for joint in robot.joint_names]


FORMS = {
    "permuted": (lambda leg, place: f"{leg}_{UNITREE[place]}_joint", "same name"),
    "namespace": (lambda leg, place: f"robot1/{leg}_{UNITREE[place]}_joint", "spelling"),
    "Gazebo": (lambda leg, place: f"a1::{leg}_{UNITREE[place]}", "spelling"),
    "prefix": (lambda leg, place: f"a1_{leg}_{UNITREE[place]}_joint", "spelling"),
    "capitals": (lambda leg, place: f"{leg.lower()}-{UNITREE[place].upper()}", "spelling"),
    "camel": (lambda leg, place: f"{leg}{UNITREE[place].title()}Joint", "spelling"),
    "ANYmal": (lambda leg, place: f"{HIND[leg].upper()}_{('HAA', 'HFE', 'KFE')[place]}", "leg and place"),
    "Spot": (lambda leg, place: f"{HIND[leg][::-1]}.{('hx', 'hy', 'kn')[place]}", "leg and place"),
    "cheetah": (lambda leg, place: f"{leg}_{('abad', 'hip', 'knee')[place]}", "leg and place"),
    "words": (lambda leg, place: f"{LONG[leg]}_{('hip_x', 'hip_y', 'knee')[place]}", "leg and place"),
    "axes": (lambda leg, place: f"{LONG[leg]}_{('hip_roll', 'hip_pitch', 'knee_pitch')[place]}", "leg and place"),
    "micro": (lambda leg, place: f"{LONG[leg]}_{('shoulder', 'leg', 'foot')[place]}", "leg and place"),
    "numbers": (lambda leg, place: f"{leg}_{place}", "leg and place"),
    "numbers from one": (lambda leg, place: f"joint_{place + 1}_{HIND[leg]}", "leg and place"),
}


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
def test_names_that_people_use(a1, form):
    name, how = form
    found = map_joints(a1, names(name))
    assert found.columns.tolist() == columns(a1)
    assert {match.how for match in found.matches} == {how}
    assert found.ignored == ()


def test_joints_of_an_arm_are_ignored_and_named(a1):
    logged = ["arm_0", *names(lambda leg, place: f"{leg}_{UNITREE[place]}_joint"), "gripper"]
    found = map_joints(a1, logged)
    assert found.ignored == ("arm_0", "gripper")
    assert found.columns.tolist() == [column + 1 for column in columns(a1)]
    assert found.to_dict()["joints"]["FL_hip_joint"] == {"log": "FL_hip_joint", "how": "same name"}


def test_legs_of_two_joints_take_hip_pitch_and_knee(two_jointed):
    found = map_joints(two_jointed, names(lambda leg, place: f"{leg}_{('abad', 'thigh', 'knee')[place]}"))
    assert {match.log_joint for match in found.matches if match.robot_joint.startswith("FL")} == {"FL_thigh", "FL_knee"}
    assert len(found.ignored) == 4


@pytest.mark.filterwarnings("ignore::equipoise.errors.ModelWarning")
def test_robots_of_the_catalogue_are_mapped_by_each_others_names():
    robots = []
    for name in CATALOG:
        try:
            robots.append(load_robot(name))
        except MissingDependencyError:
            continue
    robots = [robot for robot in robots if len(robot.joint_names) == 12]
    for one, other in itertools.product(robots, robots):
        found = {match.robot_joint: match.log_joint for match in map_joints(one, other.joint_names).matches}
        for leg in one.legs:
            for mine, theirs in zip(one.legs[leg].joint_names, other.legs[leg].joint_names, strict=True):
                assert found[mine] == theirs, f"{one.name} by the names of {other.name}"


def test_two_robots_in_one_log_are_ambiguous(a1):
    logged = [f"{robot}/{name}" for robot in ("a", "b") for name in a1.joint_names]
    with pytest.raises(RecordingError, match=r"FL_hip_joint may be 'a/FL_hip_joint' or 'b/FL_hip_joint'.*--joint-map"):
        map_joints(a1, logged)


def test_unrelated_names_are_listed_in_the_error(a1):
    logged = [f"j{k}" for k in range(12)]
    with pytest.raises(RecordingError) as raised:
        map_joints(a1, logged)
    for part in (
        "no name in the log resembles FL_hip_joint",
        "Found so far: none",
        "'j0'",
        "'j11'",
        "--joint-map",
    ):
        assert part in str(raised.value)


@pytest.mark.parametrize("others", [(), ("arm_1",)])
def test_a_joint_without_a_column_is_named_alone(a1, others):
    names = [name for name in a1.joint_names if name != "FR_calf_joint"]
    with pytest.raises(RecordingError) as refused:
        map_joints(a1, [*names, *others])
    message = str(refused.value)
    if others:
        assert "no name in the log resembles FR_calf_joint." in message
        assert (
            "other joints: 'arm_1'. Map them in a TOML file (--joint-map), with lines as FR_calf_joint = 'arm_1'"
            in message
        )
    else:
        assert "no columns of the joints FR_calf_joint, and none that could be theirs: record all 12 joints" in message
        assert "--joint-map" not in message


def test_the_users_joint_map_takes_precedence(a1):
    logged = names(lambda leg, place: f"{leg}_{UNITREE[place]}_joint")
    logged[logged.index("FL_calf_joint")] = "spare"
    found = map_joints(a1, logged, {"FL_calf_joint": "spare", "FR_hip_joint": logged.index("FR_hip_joint")})
    assert found.columns.tolist() == columns(a1)
    assert {match.robot_joint for match in found.matches if match.how == "given"} == {"FL_calf_joint", "FR_hip_joint"}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"FL_wing": "x"}, "names 'FL_wing', which is not a leg joint"),
        ({"FL_hip_joint": "wing"}, "gives 'wing' for FL_hip_joint"),
        ({"FL_hip_joint": 12}, "gives 12 for FL_hip_joint"),
        ({"FL_hip_joint": 3, "FR_hip_joint": 3}, "assigns 'RL_hip_joint' to two joints"),
    ],
)
def test_a_map_that_does_not_fit(a1, given, message):
    with pytest.raises(SettingsError, match=re.escape(message)):
        map_joints(a1, list(a1.joint_names)[3:] + list(a1.joint_names)[:3], given)


def test_a_map_in_a_file(tmp_path):
    file = tmp_path / "map.toml"
    file.write_text('[joints]\nFL_hip_joint = "one"\nFR_hip_joint = 2\n', encoding="utf-8")
    assert read_joint_map(file) == {"FL_hip_joint": "one", "FR_hip_joint": 2}
    file.write_text("FL_hip_joint = 1.5\n", encoding="utf-8")
    with pytest.raises(SettingsError, match="'FL_hip_joint' is something else"):
        read_joint_map(file)
    file.write_text("joints = 3\n", encoding="utf-8")
    assert read_joint_map(file) == {"joints": 3}, "the map of a joint with this name"
    file.write_text("FL_hip_joint\n", encoding="utf-8")
    with pytest.raises(SettingsError, match="cannot be read"):
        read_joint_map(file)
    with pytest.raises(SettingsError, match="cannot be read"):
        read_joint_map(tmp_path / "none.toml")


def test_motors_without_names_are_in_the_legs_order(a1, two_jointed):
    motors = [f"motor {k}" for k in range(12)]
    found = map_by_order(a1, ("FR", "FL", "RR", "RL"), motors)
    by_joint = {match.robot_joint: match.column for match in found.matches}
    assert (by_joint["FR_hip_joint"], by_joint["FL_hip_joint"], by_joint["RL_calf_joint"]) == (0, 3, 11)
    with pytest.raises(RecordingError, match="three motors a leg"):
        map_by_order(two_jointed, ("FR", "FL", "RR", "RL"), motors)
