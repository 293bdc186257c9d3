"""Pose of the IMU in the base frame, and its source: a description, a frame of the model, or an assumption."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from equipoise.conventions import FloatArray
from equipoise.errors import SettingsError, did_you_mean
from equipoise.robot.description import RobotDescription

# Words of frames' names: IMU sensors and chips, as boards and drivers name them.
_CHIPS = re.compile(
    r"gyro\w*|accel\w*|ahrs|ins|bno\w*|bm[aigx]\d+\w*|mpu\w*|i[cs]m\d+\w*|lsm\w*|l3g\w*|adis\w*|lpms\w*|hwt\d+|wt\d{3}|um[67]|"
    r"witmotion|xsens|mti\d*\w*|movella|vn\d+|vectornav|microstrain|3dm\w*|c[vx]\d\d?|g[xq]\d\d?|kvh|sbg|navx\w*|hipnuc|yesense"
)
_IN_WORDS = re.compile(r"inertial_(sensor|unit|measurement)|vn_\d")
# Other devices have their own IMUs: frames named after such a device come last.
_OF_OTHERS = {
    "cam", "camera", "optical", "lidar", "laser", "livox", "mid360", "velodyne", "ouster", "realsense", "d435", "d435i",
    "d455", "t265", "zed", "radar", "gps", "gnss",
}  # fmt: skip
_SMALL_ANGLE = 1e-6  # [rad]


@dataclass(frozen=True, eq=False)
class ImuPose:
    """Pose of the IMU in the base frame, and its source.

    Attributes:
        placement: pose in the base frame.
        base_link: name of the base link.
        frame: name of the model's frame that is used, or None.
        described: keys of the description that determine the pose: "imu_frame", "imu_position", "imu_rpy".
        others: names of further frames that are named like an IMU.
        proposed: names of unused frames that may be the IMU's: an IMU sensor of the file reads them, or their names are
            similar to an IMU's.
        frames: names of all links and sites that are fixed to the base.
    """

    placement: pin.SE3
    base_link: str
    frame: str | None
    described: tuple[str, ...]
    others: tuple[str, ...]
    proposed: tuple[str, ...]
    frames: tuple[str, ...]

    @property
    def is_assumed(self) -> bool:
        """True if neither a description nor a frame of the model determines its position."""
        return self.frame is None and "imu_position" not in self.described

    @property
    def message(self) -> str:
        """Position of the IMU and its source."""
        if self.is_assumed:
            turned = ", turned as described" if "imu_rpy" in self.described else ""
            flag = f": --imu-frame {self.proposed[0]}" if self.proposed else ""
            return f"at the origin of base link {self.base_link!r}{turned} (assumed: {self.reason}{flag})"
        more = f"; also named like an IMU: {', '.join(self.others)} (--imu-frame NAME takes one)" if self.others else ""
        return f"{self._source}, at {_millimetres(self.placement)} mm in the base frame{_turned(self.placement)}{more}"

    @property
    def line(self) -> str:
        """Line that is printed about the IMU."""
        return imu_line(self.message)

    @property
    def reason(self) -> str:
        """Reason why the pose is assumed, and the frames that may be the IMU's."""
        if not self.proposed:
            return "no frame of the model looks like an IMU"
        names = " or ".join(map(repr, self.proposed))
        return f"no frame of the model is named imu, and {names} may be the IMU's"

    @property
    def _source(self) -> str:
        numbers = [name for name in ("imu_position", "imu_rpy") if name in self.described]
        if len(numbers) == 2 or self.frame is None:
            return f"described by {' and '.join(numbers)}"
        named = " (described by imu_frame)" if "imu_frame" in self.described else ""
        return f"frame {self.frame!r}{named}" + "".join(f", {name} as described" for name in numbers)

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "frame": self.frame,
            "described": list(self.described),
            "assumed": self.is_assumed,
            "others": list(self.others),
            "proposed": list(self.proposed),
            "position_in_base": self.placement.translation.tolist(),
            "rpy_in_base": [float(angle) for angle in pin.rpy.matrixToRpy(self.placement.rotation)],
            "message": self.message,
        }


def imu_line(message: str) -> str:
    """Return the line that is printed about an IMU of this position and source."""
    return f"IMU: {message}."


def find_imu(model: pin.Model, description: RobotDescription, sensors: Sequence[str], base_link: str) -> ImuPose:
    """Return the pose of the IMU: described, of a frame on the base named like an IMU, or the origin of the base.

    Args:
        model: model whose first moving body is the base.
        sensors: names of the frames that the file's IMU sensors read.

    Raises:
        SettingsError: the described frame is not on the base.
    """
    frames = _frames_on_base(model)
    named = sorted(filter(_is_imu, frames), key=_is_of_another)
    frame = description.imu_frame or (named[0] if named else None)
    if frame is not None and frame not in frames:
        raise _not_on_base(model, frame, frames)
    placement = pin.SE3.Identity() if frame is None else pin.SE3(frames[frame])
    if description.imu_position is not None:
        placement.translation = np.array(description.imu_position)
    if description.imu_rpy is not None:
        placement.rotation = pin.rpy.rpyToMatrix(np.array(description.imu_rpy))
    keys = ("imu_frame", "imu_position", "imu_rpy")
    described = tuple(key for key in keys if getattr(description, key) is not None)
    others = () if described else tuple(named[1:])
    by_sensor = [name for name in frames if name in sensors]
    by_name = [name for name in frames if name not in sensors and _looks_like_imu(name)]
    proposed = () if named else (*by_sensor, *by_name)
    return ImuPose(placement, base_link, frame, described, others, proposed, tuple(frames))


def rpy_flag(rotation: FloatArray) -> str:
    """Return the flag that gives the IMU a (3, 3) rotation from IMU to base axes."""
    return "--imu-rpy " + " ".join(f"{angle + 0.0:.3f}" for angle in pin.rpy.matrixToRpy(rotation))


def upright_flag(rotation: FloatArray, acceleration_in_imu: FloatArray, up_in_base: Sequence[float]) -> str:
    """Return the flag that rotates the IMU by the smallest rotation that brings gravity upright.

    Args:
        rotation: (3, 3) rotation from IMU to base axes according to the model.
        acceleration_in_imu: (3,) specific force at rest, upward [m/s2].
        up_in_base: (3,) unit vector upward in base axes.
    """
    turn = pin.Quaternion.FromTwoVectors(rotation @ acceleration_in_imu, np.array(up_in_base)).matrix()
    return f"{rpy_flag(turn @ rotation)} (imu_rpy in a robot configuration) brings gravity upright; it leaves yaw open"


def _frames_on_base(model: pin.Model) -> dict[str, pin.SE3]:
    """Return poses in the base frame by name; of frames with one name the first."""
    kinds, found = (pin.FrameType.BODY, pin.FrameType.OP_FRAME), dict[str, pin.SE3]()
    for frame in model.frames:
        if frame.parentJoint == 1 and frame.type in kinds:
            found.setdefault(str(frame.name), frame.placement)
    return found


def _words(name: str) -> list[str]:
    """Return the words of a name, for example base, imu, link of base_IMULink."""
    apart = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name)
    return [word for word in re.split(r"[^a-z0-9]+", apart.lower()) if word]


def _is_imu(name: str) -> bool:
    """Return whether a word of a name is, begins or ends with "imu"; a simulation is not an IMU."""
    words = [word.rstrip("0123456789") for word in _words(name)]
    return any(word.startswith("imu") or (word.endswith("imu") and word != "simu") for word in words)


def _looks_like_imu(name: str) -> bool:
    words = _words(name)
    if _is_of_another(name):
        return False
    return any(map(_CHIPS.fullmatch, words)) or _IN_WORDS.search("_".join(words)) is not None


def _is_of_another(name: str) -> bool:
    return not _OF_OTHERS.isdisjoint(_words(name))


def _not_on_base(model: pin.Model, frame: str, frames: dict[str, pin.SE3]) -> SettingsError:
    if model.existFrame(frame):
        return SettingsError(f"imu_frame is {frame!r}, which is not fixed to the base: give a frame of the base link")
    near = did_you_mean(frame, frames)
    return SettingsError(
        f"imu_frame is {frame!r}, which is not a frame of the base; {near}those are {', '.join(frames)}"
    )


def _millimetres(placement: pin.SE3) -> str:
    return " ".join(f"{1000 * value + 0.0:.1f}" for value in placement.translation)


def _turned(placement: pin.SE3) -> str:
    if np.abs(placement.rotation - np.eye(3)).max() < _SMALL_ANGLE:
        return ""
    roll, pitch, yaw = np.degrees(pin.rpy.matrixToRpy(placement.rotation)) + 0.0
    return f", turned by roll {roll:.1f}, pitch {pitch:.1f}, yaw {yaw:.1f} deg"
