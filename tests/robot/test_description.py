"""Robot configurations: valid and invalid values."""

import dataclasses
import math

import pytest

from equipoise.errors import SettingsError
from equipoise.robot.description import RobotDescription

COMPLETE = """
base_link = "trunk"
forward = "-y"
foot_radius = 0.02
imu_position = [0.1, 0, -0.02]
imu_rpy = [0.0, 0.0, 3.14]
stance_height = 0.7
kp = 80
kd = 2.5

[foot_frames]
FL = "LF_FOOT"
RR = "RH_FOOT"

[stance]
FL_hip = 0
FL_thigh = 0.8

[joint_limits]
FL_hip = [-1, 1.5]

[locked_joints]
arm = 0.5
"""


@pytest.fixture
def from_toml(tmp_path):
    def from_toml(text):
        path = tmp_path / "robot.toml"
        path.write_text(text, encoding="utf-8")
        return RobotDescription.from_toml(path)

    return from_toml


@pytest.fixture
def refusal(from_toml, tmp_path):
    """Return the error message of a description, without the file's folder."""

    def refusal(text):
        with pytest.raises(SettingsError) as error:
            from_toml(text)
        assert error.value.exit_code == 2
        return str(error.value).replace(str(tmp_path / "robot.toml"), "robot.toml")

    return refusal


def test_every_field_can_be_written_in_toml(from_toml):
    assert from_toml(COMPLETE) == RobotDescription(
        base_link="trunk",
        foot_frames={"FL": "LF_FOOT", "RR": "RH_FOOT"},
        forward="-y",
        foot_radius=0.02,
        imu_position=(0.1, 0.0, -0.02),
        imu_rpy=(0.0, 0.0, 3.14),
        stance={"FL_hip": 0.0, "FL_thigh": 0.8},
        stance_height=0.7,
        kp=80.0,
        kd=2.5,
        joint_limits={"FL_hip": (-1.0, 1.5)},
        locked_joints={"arm": 0.5},
    )


def test_whole_numbers_become_real_ones(from_toml):
    described = from_toml(COMPLETE)
    assert type(described.kp) is float
    assert type(described.stance["FL_hip"]) is float
    assert all(type(number) is float for number in (*described.imu_position, *described.joint_limits["FL_hip"]))


def test_an_empty_file_describes_nothing(from_toml):
    assert from_toml("") == RobotDescription()


def test_a_description_round_trips_through_json(from_toml):
    described = from_toml(COMPLETE)
    assert RobotDescription.from_dict(dataclasses.asdict(described)) == described
    assert RobotDescription.from_dict(dataclasses.asdict(RobotDescription())) == RobotDescription()


KNOWN = (
    "base_link, forward, foot_frames, foot_radius, imu_frame, imu_position, imu_rpy, stance, stance_height, kp, "
    "kd, joint_limits, locked_joints"
)
REFUSED = [
    ('colour = "blue"', f"unknown key 'colour'; known are {KNOWN}"),
    ('forward = "up"', "forward is 'up'; it is an axis of the base link: +x, +y, -x or -y"),
    ("base_link = 3", "base_link is 3; it must be a text"),
    ('kp = "stiff"', "kp is 'stiff'; it must be a number"),
    ('kp = "80"', "kp is '80'; it must be a number"),
    ("kd = true", "kd is True; it must be a number"),
    ("imu_position = [0, 0]", "imu_position is [0, 0]; it must be 3 numbers"),
    ('imu_rpy = "123"', "imu_rpy is '123'; it must be 3 numbers"),
    ('imu_rpy = [0, 0, "up"]', "imu_rpy[2] is 'up'; it must be a number"),
    ("foot_frames = 3", "foot_frames is 3; it must be a table"),
    ("[foot_frames]\nFL = 3", "foot_frames.FL is 3; it must be a text"),
    ('stance = "low"', "stance is 'low'; it must be a table"),
    ("[stance]\nFL_hip = [1]", "stance.FL_hip is [1]; it must be a number"),
    ("[locked_joints]\narm = false", "locked_joints.arm is False; it must be a number"),
    ("[joint_limits]\nFL_hip = 1.0", "joint_limits.FL_hip is 1.0; it must be 2 numbers"),
    ("[joint_limits]\nFL_hip = [1]", "joint_limits.FL_hip is [1]; it must be 2 numbers"),
    ('[foot_frames]\nLF = "foot"', "foot_frames names a leg 'LF'; the legs are FL, FR, RL, RR"),
    ("foot_radius = 0", "foot_radius is 0.0; it must be a positive number"),
    ("kp = -1", "kp is -1.0; it must be a positive number"),
    ("kd = inf", "kd is inf; it must be a positive number"),
    ("stance_height = nan", "stance_height is nan; it must be a positive number"),
    ("stance_height = 1", "stance_height is 1.0; it is a fraction of the leg length and must be below 1"),
    ("imu_position = [0, nan, 0]", "imu_position must be finite, got 0.0, nan, 0.0"),
    ("imu_rpy = [0, 0, 90]", "imu_rpy is 0.0, 0.0, 90.0, which is beyond a whole turn; radians, not degrees?"),
    ("[locked_joints]\narm = nan", "locked_joints.arm must be finite, got nan"),
    ("[stance]\nFL_hip = inf", "stance.FL_hip must be finite, got inf"),
    (
        "[joint_limits]\nFL_hip = [1, 1]",
        "joint_limits of 'FL_hip' are 1.0 to 1.0; the lower one comes first, and they may not be equal",
    ),
    (
        "[joint_limits]\nFL_hip = [0, nan]",
        "joint_limits of 'FL_hip' are 0.0 to nan; the lower one comes first, and they may not be equal",
    ),
]


@pytest.mark.parametrize(("text", "message"), REFUSED, ids=[text.replace("\n", " ") for text, _ in REFUSED])
def test_invalid_values_are_refused_with_key_and_value(refusal, text, message):
    assert refusal(text) == f"robot configuration 'robot.toml': {message}"


def test_invalid_toml_is_refused_with_its_place(refusal, tmp_path):
    assert refusal("kp 3").startswith("robot configuration 'robot.toml' is not TOML: Expected '='")
    (tmp_path / "picture.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SettingsError, match="is not TOML"):
        RobotDescription.from_toml(tmp_path / "picture.toml")


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(SettingsError) as error:
        RobotDescription.from_toml(tmp_path / "none.toml")
    assert str(error.value) == f"robot configuration '{tmp_path / 'none.toml'}' does not exist"
    with pytest.raises(SettingsError, match="cannot be read: Is a directory"):
        RobotDescription.from_toml(tmp_path)


def test_an_imu_may_be_turned_by_a_whole_turn():
    assert RobotDescription(imu_rpy=(0.0, 0.0, -2 * math.pi)).imu_rpy == (0.0, 0.0, -2 * math.pi)
    with pytest.raises(SettingsError, match=r"radians, not degrees\?$"):
        RobotDescription(imu_rpy=(0.0, 0.0, -2.01 * math.pi))


def test_numbers_given_in_python_are_checked_too():
    with pytest.raises(SettingsError, match=r"^foot_radius is -1; it must be a positive number$"):
        RobotDescription(foot_radius=-1)
    with pytest.raises(SettingsError, match=r"^locked_joints\.arm must be finite, got nan$"):
        RobotDescription(locked_joints={"arm": math.nan})


def test_flags_win_over_the_file_where_they_are_set(from_toml):
    file, flags = from_toml(COMPLETE), RobotDescription(kp=50.0, imu_rpy=(1.0, 0.0, 0.0), locked_joints={"arm": 0.1})
    both = file.overridden_by(flags)
    assert (both.kp, both.imu_rpy, both.locked_joints) == (50.0, (1.0, 0.0, 0.0), {"arm": 0.1})
    assert dataclasses.replace(both, kp=file.kp, imu_rpy=file.imu_rpy, locked_joints=file.locked_joints) == file


def test_flags_that_are_not_set_change_nothing(from_toml):
    file = from_toml(COMPLETE)
    assert file.overridden_by(RobotDescription()) == file
    assert RobotDescription().overridden_by(file) == file


def test_an_invalid_flag_is_refused_when_merged(from_toml):
    with pytest.raises(SettingsError):
        from_toml(COMPLETE).overridden_by(RobotDescription(stance_height=1.5))
