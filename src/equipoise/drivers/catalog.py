"""Platforms by name: where each one's driver is, how it starts, and what can be set."""

from __future__ import annotations

import dataclasses
import importlib
import sys
import typing
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from equipoise.drivers.hardware import Link
from equipoise.errors import MissingDependencyError, SettingsError
from equipoise.robot.model import RobotModel

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

SIMULATED = ("mujoco", "dart")
"""Platforms that are engines: `simulate` makes them."""


@dataclasses.dataclass(frozen=True)
class Driver:
    """A real robot's way in.

    Attributes:
        name: of the platform.
        what: it is for, in a line.
        start: how it starts, in a line or two.
        page: of the documents.
        module: that holds `open_link(robot, settings)`.
        settings: name of the settings' class in it.
        preset: settings that belong to the name.
    """

    name: str
    what: str
    start: str
    page: str
    module: str
    settings: str
    preset: Mapping[str, Any] = dataclasses.field(default_factory=dict[str, Any])


DRIVERS: dict[str, Driver] = {
    driver.name: driver
    for driver in (
        Driver(
            "unitree-go2", "Unitree Go2, by SDK2 messages over CycloneDDS",
            "robot lies, cable in, --set interface=eth0; its sport mode is released before the first command",
            "docs/unitree-go2.md", "equipoise.drivers.unitree.dds", "UnitreeDdsSettings",
        ),
        Driver(
            "unitree-b2", "Unitree B2, by the same messages as the Go2",
            "as unitree-go2", "docs/unitree-go2.md", "equipoise.drivers.unitree.dds", "UnitreeB2Settings",
        ),
        Driver(
            "ros2", "Gazebo and ros2_control robots: JointState and Imu in, position commands out; no ROS needed here",
            "load a position controller, --set interface=eth0 domain=0; topics and joint order are settings",
            "docs/ros2.md", "equipoise.drivers.ros2.driver", "Ros2Settings",
        ),
        Driver(
            "unitree-a1", "Unitree A1 over UDP (beta: never tried on a robot)",
            "robot lies in low-level mode, this computer in its network 192.168.123.x",
            "docs/unitree-udp.md", "equipoise.drivers.unitree.udp", "UnitreeUdpSettings", {"protocol": "a1"},
        ),
        Driver(
            "unitree-go1", "Unitree Go1 over UDP (beta: never tried on a robot)",
            "robot lies in low-level mode, this computer in its network 192.168.123.x",
            "docs/unitree-udp.md", "equipoise.drivers.unitree.udp", "UnitreeUdpSettings", {"protocol": "go1"},
        ),
    )
}  # fmt: skip


def open_link(name: str, robot: RobotModel, given: Mapping[str, Any]) -> Link:
    """The link alone; raises SettingsError, MissingDependencyError and CommunicationError."""
    module, settings = _driven_by(name, given)
    link: Link = module.open_link(robot, settings)
    return link


def open_beside(name: str, robot: RobotModel, given: Mapping[str, Any]) -> Link:
    """A watchdog's link, beside that of another process, which commands the robot and may hang; raises as `open_link`.

    A driver's module may have an `open_beside(robot, settings)` for it. That takes nothing over and disturbs nothing until it
    sends, and its `send` raises CommunicationError while nobody hears it.
    """
    module, settings = _driven_by(name, given)
    link: Link = getattr(module, "open_beside", module.open_link)(robot, settings)
    return link


def settings_of(name: str) -> list[tuple[str, str, Any]]:
    """Names, types and defaults of a driver's settings; raises MissingDependencyError if it cannot be used here."""
    driver = _driver(name)
    kind = getattr(_module(driver), driver.settings)
    return [
        (field.name, _named(hint), driver.preset.get(field.name, field.default))
        for field, hint in _fields(kind).values()
    ]


def given_settings(pairs: Sequence[str], path: Path | None) -> dict[str, Any]:
    """Settings from KEY=VALUE texts and a TOML file; the texts win.

    Raises:
        SettingsError: a text that is no pair, or a file that cannot be read.
    """
    table: dict[str, Any] = {}
    if path is not None:
        try:
            table = tomllib.loads(path.read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
            raise SettingsError(f"the settings file {str(path)!r} cannot be read: {error}") from error
    for pair in pairs:
        key, equals, value = pair.partition("=")
        if not equals or not key:
            raise SettingsError(f"{pair!r} is no KEY=VALUE, as in interface=eth0")
        table[key.strip().replace("-", "_")] = value.strip()
    return table


def read_settings(kind: type[Any], given: Mapping[str, Any], name: str) -> Any:
    """A settings object from values by name; text is read as what the setting is."""
    fields = _fields(kind)
    unknown = [key for key in given if key not in fields]
    if unknown:
        raise SettingsError(
            f"platform {name!r} has no setting {unknown[0]!r}; it has {', '.join(fields)} (see 'equipoise platforms')"
        )
    return kind(**{key: _read(value, fields[key][1], key) for key, value in given.items()})


def _driven_by(name: str, given: Mapping[str, Any]) -> tuple[Any, Any]:
    """A driver's module and its settings."""
    driver = _driver(name)
    module = _module(driver)
    return module, read_settings(getattr(module, driver.settings), {**driver.preset, **given}, name)


def _driver(name: str) -> Driver:
    try:
        return DRIVERS[name]
    except KeyError:
        raise SettingsError(
            f"platform {name!r} is not known; robots are {', '.join(DRIVERS)}, simulators are {', '.join(SIMULATED)}"
        ) from None


def _module(driver: Driver) -> Any:
    """A driver's module; whatever a broken package of its does when it is imported, the error is ours."""
    try:
        return importlib.import_module(driver.module)
    except MissingDependencyError:
        raise
    except Exception as error:
        raise MissingDependencyError(
            f"platform {driver.name!r} needs a package that is broken ({type(error).__name__}: {error}): install it again"
        ) from error


def _fields(kind: type[Any]) -> dict[str, tuple[dataclasses.Field[Any], Any]]:
    hints = typing.get_type_hints(kind)
    return {field.name: (field, hints[field.name]) for field in dataclasses.fields(kind)}


def _read(value: Any, hint: Any, key: str) -> Any:
    """A value as its setting's type."""
    kinds = [kind for kind in (typing.get_args(hint) or (hint,)) if kind is not type(None)]
    origin = typing.get_origin(hint)
    if origin is typing.Literal:
        return value  # the settings refuse what they do not know
    if hint is tuple or origin is tuple or any(typing.get_origin(kind) is tuple for kind in kinds):
        return tuple(part.strip() for part in value.split(",")) if isinstance(value, str) else tuple(value)
    if not isinstance(value, str):
        return float(value) if float in kinds and isinstance(value, int) and not isinstance(value, bool) else value
    if value.lower() in ("none", "") and len(typing.get_args(hint)) > len(kinds):
        return None
    for kind, read in ((bool, _truth), (int, int), (float, float)):
        if kind in kinds:
            try:
                return read(value)
            except ValueError:
                raise SettingsError(f"setting {key} is {value!r}; it must be {_named(hint)}") from None
    return value


def _truth(text: str) -> bool:
    words = {"true": True, "yes": True, "on": True, "1": True, "false": False, "no": False, "off": False, "0": False}
    if text.lower() not in words:
        raise ValueError(text)
    return words[text.lower()]


def _named(hint: Any) -> str:
    """A type, as a user says it."""
    if typing.get_origin(hint) is typing.Literal:
        return " or ".join(str(value) for value in typing.get_args(hint))
    words = {str: "text", int: "a whole number", float: "a number", bool: "yes or no", type(None): "none"}
    kinds = typing.get_args(hint) if typing.get_origin(hint) is not tuple else ()
    return " or ".join(words.get(kind, "names, with commas") for kind in (kinds or (hint,)))
