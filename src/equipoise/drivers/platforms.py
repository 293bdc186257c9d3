"""Platforms by name: driver, start posture and settings. Listing them imports no driver."""

from __future__ import annotations

import dataclasses
import importlib
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from equipoise.drivers.platform_settings import read_settings, setting_row, settings_of_class, settings_of_platform
from equipoise.errors import CommunicationError, EquipoiseError, MissingDependencyError, SettingsError
from equipoise.platform.engines import ENGINES
from equipoise.plugins import Table, import_users, resolve
from equipoise.user_file import read_text, toml_table

if TYPE_CHECKING:
    from equipoise.drivers.hardware import HardwarePlatform, RobotConnection
    from equipoise.platform.stepped import SteppedPlatform
    from equipoise.robot.model import RobotModel

NEEDED = ("read", "step", "close")
"""Methods of a platform that is a class."""


@dataclasses.dataclass(frozen=True)
class Driver:
    """Driver of a real robot. Its parts are named by text, so that a list of drivers imports none of them.

    Attributes:
        name: name of the platform.
        what: robot or bus, in one line.
        start: start posture of the robot, in a line or two.
        page: page of the documents, or an address.
        module: module with `open_connection(robot, settings)`, which returns a `RobotConnection`, and optionally
            `open_second_connection` (see `open_second`).
        settings: dataclass of its settings, as "my_package.settings:MySettings"; each has a default.
        preset: settings that belong to the name.
        makers_gains: stiffness [Nm/rad] and damping [Nm s/rad] of the maker's own stand example; None: not known.
        motor_speeds: largest speeds of each leg's hip, thigh and calf motor, from the maker's URDF [rad/s]; None: not known.
        needs: module that raises MissingDependencyError on import if the driver cannot be used; empty: none.
    """

    name: str
    what: str
    start: str
    page: str
    module: str
    settings: str
    preset: Mapping[str, Any] = dataclasses.field(default_factory=dict[str, Any])
    needs: str = ""
    makers_gains: tuple[float, float] | None = None
    motor_speeds: tuple[float, float, float] | None = None


_DDS = "equipoise.drivers.dds.cyclone"
DRIVERS: dict[str, Driver] = {
    driver.name: driver
    for driver in (
        Driver(
            "unitree-go2", "Unitree Go2, by SDK2 messages over CycloneDDS",
            "robot lies, cable in, --set interface=eth0; its sport mode is released before the first command",
            "docs/hardware/unitree-go2-b2.md", "equipoise.drivers.unitree.dds",
            "equipoise.drivers.unitree.dds_settings:UnitreeDdsSettings", needs=_DDS, makers_gains=(60.0, 5.0),
            motor_speeds=(30.1, 30.1, 20.07),
        ),
        Driver(
            "unitree-b2", "Unitree B2, by the same messages as the Go2",
            "as unitree-go2", "docs/hardware/unitree-go2-b2.md", "equipoise.drivers.unitree.dds",
            "equipoise.drivers.unitree.dds_settings:UnitreeB2Settings", needs=_DDS, makers_gains=(1000.0, 10.0),
            motor_speeds=(23.0, 23.0, 14.0),
        ),
        Driver(
            "ros2", "Gazebo and ros2_control robots: JointState and Imu in, positions or impedance out; no ROS needed here",
            "load command controllers, --set interface=eth0 --set stack=NAME; topics and joint order are settings",
            "docs/hardware/ros2.md", "equipoise.drivers.ros2.driver", "equipoise.drivers.ros2.ros2_settings:Ros2Settings",
            needs=_DDS,
        ),
        Driver(
            "unitree-a1", "Unitree A1 over UDP (beta: not tested on a robot)",
            "robot lies in low-level mode, this computer in its network 192.168.123.x",
            "docs/hardware/unitree-a1-go1.md", "equipoise.drivers.unitree.udp",
            "equipoise.drivers.unitree.udp_settings:UnitreeUdpSettings", {"protocol": "a1"},
            motor_speeds=(21.0, 21.0, 21.0),
        ),
        Driver(
            "unitree-go1", "Unitree Go1 over UDP (beta: not tested on a robot)",
            "robot lies in low-level mode, this computer in its network 192.168.123.x",
            "docs/hardware/unitree-a1-go1.md", "equipoise.drivers.unitree.udp",
            "equipoise.drivers.unitree.udp_settings:UnitreeUdpSettings", {"protocol": "go1"},
            motor_speeds=(30.1, 30.1, 30.1),
        ),
    )
}  # fmt: skip
"""Drivers of this package."""
PLATFORMS: Table[Driver | type[Any] | None] = Table(
    "platform", "equipoise.platforms", (Driver, type), {**dict.fromkeys(ENGINES), **DRIVERS}
)
"""Platforms of this and other packages: drivers, or classes as `equipoise.SteppedPlatform`. A simulator has None."""


def find_platform(name: str) -> Driver | type[Any] | None:
    """Return the platform of a name or of MODULE:NAME, which may be in the current folder; None: a simulator.

    Raises:
        SettingsError: the platform does not exist, or two have the name.
        MissingDependencyError: another package's platform fails, or is not a platform.
    """
    if ":" in name:
        row = import_users("platform", name)
        if not isinstance(row, (Driver, type)):
            raise MissingDependencyError(
                f"platform {name!r} is of type {type(row).__name__}; it must be a class, or a Driver"
            )
    elif name in PLATFORMS:
        row = PLATFORMS[name]
    else:
        robots = ", ".join(other for other in PLATFORMS if other not in ENGINES)
        raise SettingsError(
            f"platform {name!r} is not known; robots are {robots}, simulators are {', '.join(ENGINES)}; a class of your "
            "own is MODULE:CLASS"
        )
    return _checked(name, row) if isinstance(row, type) else row


def for_platform(name: str, robot: RobotModel) -> RobotModel:
    """Return a robot model with the platform's motor data where the model has none.

    The maker's gains are used unless the robot configuration has kp or kd. Joints without a speed limit, as in MJCF files,
    get that of their motors.

    Raises:
        SettingsError: the platform does not exist, or its robots have other joints.
    """
    driver = find_platform(name)
    if not isinstance(driver, Driver):
        return robot
    description, speeds = robot.description, robot.velocity_limit.copy()
    if driver.makers_gains is not None and description.kp is None and description.kd is None:
        kp, kd = driver.makers_gains
        description = dataclasses.replace(description, kp=kp, kd=kd)
    if driver.motor_speeds is not None:
        if robot.leg_joints.shape[1] != (each := len(driver.motor_speeds)):
            raise SettingsError(
                f"robots of {name} have {each} joints per leg; {robot.name!r} has {robot.leg_joints.shape[1]}: pass another "
                "--platform, or the model of that robot"
            )
        motors = dict(zip(robot.leg_joints.ravel().tolist(), 4 * driver.motor_speeds, strict=True))
        for joint, speed in motors.items():
            speeds[joint] = speed if math.isinf(speeds[joint]) else speeds[joint]
    return dataclasses.replace(robot, description=description, velocity_limit=speeds)


def open_connection(name: str, robot: RobotModel, given: Mapping[str, Any]) -> RobotConnection:
    """Return the connection of a driver; raise SettingsError, MissingDependencyError or CommunicationError."""
    return _opened("open_connection", name, robot, given)


def open_platform(name: str, robot: RobotModel, given: Mapping[str, Any]) -> HardwarePlatform | SteppedPlatform:
    """Connect to a robot without a guard: to observe it, or for the robot process.

    Nothing is sent before the first command, except over UDP: a robot only answers, so packets without torque are sent.

    Args:
        name: name of a driver, or of a platform class, as "my_robot:MyRobot".
        robot: model of the robot.
        given: settings by name; text is converted to the setting's type.

    Raises:
        SettingsError: the platform or a setting does not exist, or a value is invalid.
        MissingDependencyError: the driver's package is not installed, or a class of another package fails.
        CommunicationError: the network cannot be used.
    """
    from equipoise.drivers.hardware import HardwarePlatform  # noqa: PLC0415 - lists need no NumPy
    from equipoise.drivers.home_built import open_home_built  # noqa: PLC0415

    row = find_platform(name)
    if isinstance(row, type):
        return open_home_built(name, row, robot, given)
    return HardwarePlatform(open_connection(name, robot, given))


def open_second(name: str, robot: RobotModel, given: Mapping[str, Any]) -> RobotConnection | None:
    """Return the second connection to a robot that the robot process commands; None: the platform has none.

    It has no effect until it sends; its `send` raises CommunicationError while no robot receives. A driver's module may
    define `open_second_connection(robot, settings)`, a class a class method `second(robot, **settings)`.
    """
    from equipoise.drivers.home_built import open_second_of_class  # noqa: PLC0415 - lists need no NumPy

    row = find_platform(name)
    if isinstance(row, type):
        return open_second_of_class(name, row, robot, given)
    return _opened("open_second_connection", name, robot, given)


@dataclasses.dataclass(frozen=True)
class PlatformRow:
    """Row of a platform in the list of platforms.

    Attributes:
        name, what, start, page: texts of the driver.
        settings: name, type in words and default of each setting; or the reason why it cannot be used on this machine.
    """

    name: str
    what: str
    start: str
    page: str
    settings: list[tuple[str, str, Any]] | str


def describe_platforms() -> list[PlatformRow]:
    """Return a row for each platform of a robot."""
    rows: list[PlatformRow] = []
    for name, row in PLATFORMS.rows().items():
        if row is None:
            continue
        try:
            settings = settings_of(name)
        except EquipoiseError as error:
            settings = f"cannot be used here: {error}"
        if isinstance(row, Driver):
            what, start, page = row.what, row.start, row.page
        else:
            about = "" if isinstance(row, EquipoiseError) else row.__doc__ or row.__name__
            what, start, page = next(iter(about.strip().splitlines()), ""), "", ""
        rows.append(PlatformRow(name, what, start, page, settings))
    return rows


def settings_of(name: str) -> list[tuple[str, str, Any]]:
    """Return names, types and defaults of a platform's settings; raise MissingDependencyError if it cannot be used here."""
    row = find_platform(name)
    if row is None:
        return []
    if isinstance(row, type):
        return [setting_row(setting) for setting in settings_of_platform(row).values()]
    if row.needs:
        _imported(row, row.needs)
    settings = settings_of_class(_imported(row, row.settings)).values()
    return [setting_row(each.replace(default=row.preset.get(each.name, each.default))) for each in settings]


def given_settings(pairs: Sequence[str], path: Path | None) -> dict[str, Any]:
    """Return settings from KEY=VALUE texts and a TOML file; the texts take precedence.

    Raises:
        SettingsError: a text is not a pair, or the file cannot be read.
    """
    table: dict[str, Any] = {}
    if path is not None:
        try:
            table = toml_table(read_text(path))
        except (OSError, ValueError) as error:
            raise SettingsError(f"the settings file {str(path)!r} cannot be read: {error}") from error
    for pair in pairs:
        key, equals, value = pair.partition("=")
        if not equals or not key:
            raise SettingsError(f"{pair!r} is not a KEY=VALUE pair, as in interface=eth0")
        table[key.strip().replace("-", "_")] = value.strip()
    return table


def _opened(function: str, name: str, robot: RobotModel, given: Mapping[str, Any]) -> RobotConnection:
    driver = find_platform(name)
    if not isinstance(driver, Driver):
        raise SettingsError(f"platform {name!r} has no driver: it is a class or a simulator")
    module = _imported(driver, driver.module)
    settings = read_settings(_imported(driver, driver.settings), {**driver.preset, **given}, name)
    try:
        connection: RobotConnection = getattr(module, function, module.open_connection)(robot, settings)
    except EquipoiseError:
        raise
    except OSError as error:
        raise CommunicationError(f"platform {name!r} cannot be opened: {error}") from error
    return connection


def _checked(name: str, kind: type[Any]) -> type[Any]:
    """Return the class itself; raise MissingDependencyError if it is not a platform."""
    abstract: frozenset[str] = getattr(kind, "__abstractmethods__", frozenset())
    lacking = [method for method in NEEDED if method in abstract or not callable(getattr(kind, method, None))]
    if lacking:
        raise MissingDependencyError(
            f"platform {name!r}: the class {kind.__name__!r} lacks {', '.join(lacking)}; a platform has {', '.join(NEEDED)} "
            "and control_period [s], see equipoise.SteppedPlatform"
        )
    return kind


def _imported(driver: Driver, path: str) -> Any:
    """Import a driver's module or settings; raise MissingDependencyError for any error in it."""
    try:
        return resolve(path) if ":" in path else importlib.import_module(path)
    except MissingDependencyError:
        raise
    except Exception as error:
        raise MissingDependencyError(
            f"platform {driver.name!r} needs a package that is broken ({type(error).__name__}: {error}): reinstall it"
        ) from error
