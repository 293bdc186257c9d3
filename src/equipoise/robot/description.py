"""What a user may say about a robot that its model file leaves out or gets wrong."""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from equipoise.errors import SettingsError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

LEG_NAMES = ("FL", "FR", "RL", "RR")


@dataclass(frozen=True)
class RobotDescription:
    """Overrides of what is otherwise found in the model file. Nothing here is required.

    Read from a TOML file whose keys are the field names, from flags, or from both (flags win).
    """

    base_link: str | None = None
    """Name of the trunk link, where it is not the first link with mass."""
    foot_frames: dict[str, str] = field(default_factory=dict[str, str])
    """Frame at each foot's centre, by leg: FL, FR, RL, RR."""
    foot_radius: float | None = None
    """Radius of the feet [m]."""
    imu_position: tuple[float, float, float] | None = None
    """IMU position in the base frame [m]."""
    imu_rpy: tuple[float, float, float] | None = None
    """IMU orientation in the base frame, roll pitch yaw [rad]."""
    stance: dict[str, float] = field(default_factory=dict[str, float])
    """Nominal stance: position by joint name [rad]; all leg joints."""
    stance_height: float | None = None
    """Nominal hip height as a fraction of the leg length; default about 0.75."""
    kp: float | None = None
    """Joint position gain [Nm/rad]; default 100 x m g h / 38 Nm."""
    kd: float | None = None
    """Joint velocity gain [Nm s/rad]; default 3 x m g h / 38 Nm."""
    joint_limits: dict[str, tuple[float, float]] = field(default_factory=dict[str, "tuple[float, float]"])
    """Narrower or missing position limits by joint name: lower upper [rad]."""
    held: dict[str, float] = field(default_factory=dict[str, float])
    """Where joints that are no leg's are held, by joint name [rad]; default 0."""

    def __post_init__(self) -> None:
        for leg in self.foot_frames:
            if leg not in LEG_NAMES:
                raise SettingsError(f"foot_frames names a leg {leg!r}; the legs are {', '.join(LEG_NAMES)}")
        for name in ("foot_radius", "stance_height", "kp", "kd"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise SettingsError(f"{name} is {value}; it must be a positive number")
        if self.stance_height is not None and self.stance_height >= 1:
            raise SettingsError(
                f"stance_height is {self.stance_height}; it is a fraction of the leg length and must be below 1"
            )
        for joint, (lower, upper) in self.joint_limits.items():
            if not lower < upper:
                raise SettingsError(f"joint_limits of {joint!r} are {lower} to {upper}; the lower one comes first")

    @classmethod
    def from_toml(cls, path: str | Path) -> RobotDescription:
        """Read a description; an unknown key or a wrong type raises SettingsError naming it."""
        try:
            with open(path, "rb") as file:
                table = tomllib.load(file)
        except FileNotFoundError:
            raise SettingsError(f"robot description {str(path)!r} does not exist") from None
        except OSError as error:
            raise SettingsError(f"robot description {str(path)!r} cannot be read: {error.strerror}") from error
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise SettingsError(f"robot description {str(path)!r} is not TOML: {error}") from error
        try:
            return cls.from_dict(table)
        except SettingsError as error:
            raise SettingsError(f"robot description {str(path)!r}: {error}") from error

    @classmethod
    def from_dict(cls, table: Mapping[str, Any]) -> RobotDescription:
        """From TOML or JSON values by field name."""
        fields = {f.name for f in dataclasses.fields(cls)}
        for key in table:
            if key not in fields:
                raise SettingsError(f"unknown key {key!r}; known are {', '.join(sorted(fields))}")
        try:
            return cls(**{key: _converted(key, value) for key, value in table.items() if value is not None})
        except SettingsError:
            raise
        except (TypeError, ValueError, AttributeError) as error:
            raise SettingsError(f"a value has the wrong type: {error}") from error

    def overridden_by(self, other: RobotDescription) -> RobotDescription:
        """This description with every value that `other` sets taken from `other`."""
        default = RobotDescription()
        set_there = {
            f.name: getattr(other, f.name)
            for f in dataclasses.fields(self)
            if getattr(other, f.name) != getattr(default, f.name)
        }
        return dataclasses.replace(self, **set_there)


def _converted(key: str, value: Any) -> Any:
    """TOML values as the field's type: numbers to float, arrays to tuples."""
    if key == "base_link":
        if not isinstance(value, str):
            raise TypeError(f"base_link is {value!r}, not a link's name")
        return value
    if key == "foot_frames":
        return {str(leg): str(frame) for leg, frame in value.items()}
    if key in ("imu_position", "imu_rpy"):
        x, y, z = value
        return float(x), float(y), float(z)
    if key in ("stance", "held"):
        return {str(joint): float(position) for joint, position in value.items()}
    if key == "joint_limits":
        return {str(joint): (float(lower), float(upper)) for joint, (lower, upper) in value.items()}
    return float(value)
