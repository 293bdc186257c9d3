"""Platforms by name, and their settings as users give them."""

import dataclasses
import re
from typing import Literal, get_args

import numpy as np
import pytest

from equipoise.cli import flags
from equipoise.drivers.platform_settings import read_settings
from equipoise.drivers.platforms import (
    DRIVERS,
    PLATFORMS,
    for_platform,
    given_settings,
    open_connection,
    settings_of,
)
from equipoise.errors import SettingsError
from equipoise.platform.engines import ENGINES
from equipoise.terminal.robot_reports import gain_lines


@dataclasses.dataclass(frozen=True)
class Settings:
    interface: str = "eth0"
    domain: int = 0
    rate: float = 500.0
    careful: bool = True
    peers: tuple[str, ...] = ()
    stiffness: float | None = None
    protocol: Literal["a1", "go1"] = "a1"


def read(**given):
    return read_settings(Settings, given, "robot")


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"interface": "lo"}, "lo"),
        ({"domain": "7"}, 7),
        ({"rate": "250"}, 250.0),
        ({"rate": 250}, 250.0),
        ({"careful": "no"}, False),
        ({"careful": "True"}, True),
        ({"peers": "10.0.0.1, b"}, ("10.0.0.1", "b")),
        ({"peers": ["a", "b"]}, ("a", "b")),
        ({"stiffness": "80"}, 80.0),
        ({"stiffness": "none"}, None),
        ({"protocol": "go1"}, "go1"),
    ],
)
def test_text_is_read_as_what_the_setting_is(given, expected):
    value = getattr(read(**given), next(iter(given)))
    assert value == expected
    assert type(value) is type(expected)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"domain": "x"}, "setting domain is 'x'; it must be a whole number"),
        ({"careful": "perhaps"}, "setting careful is 'perhaps'; it must be yes or no"),
        ({"stiffness": "soft"}, "setting stiffness is 'soft'; it must be a number or none"),
        ({"colour": "red"}, "platform 'robot' has no setting 'colour'; it has interface, domain, rate"),
    ],
)
def test_what_no_setting_can_be_is_refused(given, message):
    with pytest.raises(SettingsError, match=re.escape(message)):
        read(**given)


def test_pairs_win_over_the_file(tmp_path):
    path = tmp_path / "robot.toml"
    path.write_text('interface = "eth1"\ndomain = 3\n', encoding="utf-8")
    assert given_settings(("interface=lo", "command-rate=100"), path) == {
        "interface": "lo", "domain": 3, "command_rate": "100",
    }  # fmt: skip


@pytest.mark.parametrize("pair", ["interface", "=lo", ""])
def test_a_pair_needs_a_key_and_an_equals_sign(pair):
    with pytest.raises(SettingsError, match="is not a KEY=VALUE pair, as in interface=eth0"):
        given_settings((pair,), None)


def test_a_settings_file_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(SettingsError, match=r"the settings file '.*none.toml' cannot be read: "):
        given_settings((), tmp_path / "none.toml")
    (tmp_path / "bad.toml").write_text("interface = ", encoding="utf-8")
    with pytest.raises(SettingsError, match=r"the settings file '.*bad.toml' cannot be read: "):
        given_settings((), tmp_path / "bad.toml")


def test_every_driver_has_settings_with_defaults_and_a_page():
    for name, driver in DRIVERS.items():
        assert driver.name == name
        assert driver.page.startswith("docs/")
        for setting, kind, default in settings_of(name):
            assert setting
            assert kind
            assert default is not dataclasses.MISSING


def test_the_error_of_an_unknown_platform_lists_all_platforms(a1):
    with pytest.raises(SettingsError) as caught:
        open_connection("spot", a1, {})
    assert str(caught.value) == (
        "platform 'spot' is not known; robots are unitree-go2, unitree-b2, ros2, unitree-a1, unitree-go1, simulators are "
        "mujoco, dart; a class of your own is MODULE:CLASS"
    )


def test_the_flag_names_every_platform():
    (choices,) = (part for part in get_args(flags.PlatformName)[1:] if hasattr(part, "help"))
    assert all(name in choices.help for name in (*ENGINES, *DRIVERS))
    assert list(PLATFORMS) == [*ENGINES, *DRIVERS]


def without_speeds(robot):
    return dataclasses.replace(robot, velocity_limit=np.full(12, np.inf))


def test_a_drivers_robot_gets_the_makers_gains_and_its_motors_speeds(a1):
    robot = for_platform("unitree-b2", without_speeds(a1))
    assert robot.gains(0.3) == (1000.0, 10.0)
    for leg in robot.legs.values():
        assert robot.velocity_limit[list(leg.joints)].tolist() == [23.0, 23.0, 14.0]
    assert np.isinf(without_speeds(a1).velocity_limit).all()


@pytest.mark.parametrize("given", [{"kp": 80.0}, {"kd": 3.0}, {"kp": 80.0, "kd": 3.0}])
def test_gains_of_the_user_and_limits_of_the_model_stay(a1, given):
    mine = dataclasses.replace(a1, description=dataclasses.replace(a1.description, **given))
    robot = for_platform("unitree-go2", mine)
    assert robot.gains(0.3) == mine.gains(0.3)
    assert np.array_equal(robot.velocity_limit, a1.velocity_limit)


def test_a_platform_without_a_driver_changes_nothing(a1):
    assert for_platform("mujoco", a1) is a1
    robot = for_platform("ros2", without_speeds(a1))
    assert robot.gains(0.3) == a1.gains(0.3)
    assert np.isinf(robot.velocity_limit).all()


def test_a_robot_with_other_joints_than_the_platform_is_refused(two_jointed):
    with pytest.raises(SettingsError, match=r"robots of unitree-go2 have 3 joints per leg; '.*' has 2: pass another"):
        for_platform("unitree-go2", two_jointed)


def test_the_gains_of_a_run_are_named_as_the_makers(a1):
    assert "as in the manufacturer's example" in gain_lines(for_platform("unitree-go2", a1), "unitree-go2")[0]
    ours = gain_lines(a1, "unitree-go2")
    assert "manufacturer" not in ours[0]
    assert "--kp 60 --kd 5" in ours[1]
