"""Robot configuration: the user's additions to and corrections of a model file."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from equipoise.errors import SettingsError
from equipoise.json_form import from_json
from equipoise.user_file import read_text, toml_table

Forward = Literal["+x", "+y", "-x", "-y"]
LEG_NAMES = ("FL", "FR", "RL", "RR")


@dataclass(frozen=True)
class RobotDescription:
    """Overrides of values of the model file. All are optional.

    Read from a TOML file whose keys are the field names, from flags, or from both (flags win).

    Attributes:
        base_link: name of the trunk link; default the first link with mass.
        forward: axis of the base link that points forward, "+x", "+y", "-x" or "-y"; default by the legs' names. All
            other values are in axes whose x points forward.
        foot_frames: names of the frames at the feet's centres, by leg: FL, FR, RL, RR.
        foot_radius: radius of the feet [m].
        imu_frame: name of the model's frame at the IMU; default the first frame with "imu" in its name.
        imu_position: IMU position in the base frame [m].
        imu_rpy: IMU orientation in the base frame, roll pitch yaw [rad].
        stance: nominal stance: position by joint name [rad]; all leg joints.
        stance_height: nominal hip height as a fraction of the leg length; default about 0.75.
        kp: joint position gain [Nm/rad]; default 100 x m g h / 38 Nm.
        kd: joint velocity gain [Nm s/rad]; default 3 x m g h / 38 Nm.
        joint_limits: position limits by joint name, if the model's are missing or too wide: lower upper [rad]; wider
            ones are refused.
        locked_joints: positions of joints that do not belong to legs and are locked, by joint name [rad]; default the
            file's keyframe "home", else 0.
    """

    base_link: str | None = None
    forward: Forward | None = None
    foot_frames: dict[str, str] = field(default_factory=dict[str, str])
    foot_radius: float | None = None
    imu_frame: str | None = None
    imu_position: tuple[float, float, float] | None = None
    imu_rpy: tuple[float, float, float] | None = None
    stance: dict[str, float] = field(default_factory=dict[str, float])
    stance_height: float | None = None
    kp: float | None = None
    kd: float | None = None
    joint_limits: dict[str, tuple[float, float]] = field(default_factory=dict[str, "tuple[float, float]"])
    locked_joints: dict[str, float] = field(default_factory=dict[str, float])

    def __post_init__(self) -> None:
        if self.forward not in (None, "+x", "+y", "-x", "-y"):
            raise SettingsError(f"forward is {self.forward!r}; it is an axis of the base link: +x, +y, -x or -y")
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
        numbers = {"imu_position": self.imu_position, "imu_rpy": self.imu_rpy}
        numbers |= {
            f"{name}.{joint}": (q,) for name in ("stance", "locked_joints") for joint, q in getattr(self, name).items()
        }
        for name, values in numbers.items():
            if values is not None and not all(map(math.isfinite, values)):
                raise SettingsError(f"{name} must be finite, got {', '.join(map(str, values))}")
        if self.imu_rpy is not None and max(map(abs, self.imu_rpy)) > 2 * math.pi:
            raise SettingsError(
                f"imu_rpy is {', '.join(map(str, self.imu_rpy))}, which is beyond a whole turn; radians, not degrees?"
            )
        for joint, (lower, upper) in self.joint_limits.items():
            if not lower < upper:
                raise SettingsError(
                    f"joint_limits of {joint!r} are {lower} to {upper}; the lower one comes first, and they may not be equal"
                )

    @classmethod
    def from_toml(cls, path: str | Path) -> RobotDescription:
        """Read a TOML file; raises SettingsError with the name of an unknown key or a wrong type."""
        try:
            table = toml_table(read_text(path))
        except FileNotFoundError:
            raise SettingsError(f"robot configuration {str(path)!r} does not exist") from None
        except OSError as error:
            raise SettingsError(f"robot configuration {str(path)!r} cannot be read: {error.strerror}") from error
        except ValueError as error:
            raise SettingsError(f"robot configuration {str(path)!r} is not TOML: {error}") from error
        try:
            return cls.from_dict(table)
        except SettingsError as error:
            raise SettingsError(f"robot configuration {str(path)!r}: {error}") from error

    @classmethod
    def from_dict(cls, table: Mapping[str, Any]) -> RobotDescription:
        """Return a description from TOML or JSON values by field name."""
        return from_json(cls, {name: value for name, value in table.items() if value is not None})

    def overridden_by(self, other: RobotDescription) -> RobotDescription:
        """Return this description with every value that `other` sets taken from `other`."""
        default = RobotDescription()
        set_there = {
            f.name: getattr(other, f.name)
            for f in dataclasses.fields(self)
            if getattr(other, f.name) != getattr(default, f.name)
        }
        return dataclasses.replace(self, **set_there)
