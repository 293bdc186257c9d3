"""Reader of robot model files: the cleaned text for both engines, and the repairs.

A URDF or MJCF file is parsed once and stripped of what a calibration does not need (meshes, visuals, actuators, sensors) and
of what engines cannot read. Pinocchio (estimation) and MuJoCo (simulation) each read the cleaned text with their own reader,
so they share a file and no code.
"""

from __future__ import annotations

import hashlib
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from equipoise.errors import ModelError
from equipoise.robot.catalog import read_model_file
from equipoise.robot.cleaning.size import refuse_immense
from equipoise.robot.cleaning.urdf import clean_urdf
from equipoise.robot.cleaning.urdf_joints import Coupling, couplings_of, fix_locked_joints
from equipoise.robot.description import Forward
from equipoise.user_file import kind_of

_OTHER_KINDS = ("is a binary file", "is a JSON file", "is an MCAP recording", "is the result of a calibration")

ModelFormat = Literal["urdf", "mjcf"]

_MOST_BYTES = 100_000_000


@dataclass(frozen=True)
class ModelSource:
    """Cleaned robot model file.

    Attributes:
        path: path of the original file.
        format: format of the file, "urdf" or "mjcf".
        xml: the cleaned model, without references to other files.
        sha256: hash of the file's bytes as they are on disk.
        repairs: changes and omissions, one sentence each.
        effort_limits: torque limits by joint name [Nm], if the format keeps them outside the joint (MJCF).
        home: joint positions of the keyframe "home", by joint name [rad]; empty if the file has none.
        imu_sensors: names of the links or sites that IMU sensors of the file read.
        forward: axis of the file's base link that points forward; if not x, the model has a rotated base link above it.
        locked: positions of joints that their limits lock, by name [rad or m]; they are fixed in the cleaned model.
        couplings: elements that tie joints to each other, with the names of the joints; the cleaned model has none.
    """

    path: Path
    format: ModelFormat
    xml: str
    sha256: str
    repairs: tuple[str, ...]
    effort_limits: dict[str, float]
    home: dict[str, float] = field(default_factory=dict[str, float])
    forward: Forward = "+x"
    locked: dict[str, float] = field(default_factory=dict[str, float])
    couplings: tuple[Coupling, ...] = ()
    imu_sensors: tuple[str, ...] = ()


def read_model_source(path: str | Path, base_link: str | None = None) -> ModelSource:
    """Read and clean a URDF or MJCF file; the root element determines the format.

    Args:
        path: path of the file.
        base_link: name of the trunk's link; default the first with mass (URDF).

    Raises:
        ModelError: the file is missing, is not XML, or is neither format.
    """
    path = Path(path)
    return parse_model_source(read_model_file(path), path, base_link)


def parse_model_source(content: bytes, path: Path, base_link: str | None = None) -> ModelSource:
    """Clean the content of a model file.

    Args:
        content: content of the file.
        path: path of the file, for messages and for relative paths of included files.
        base_link: name of the trunk's link, as in `read_model_source`.

    Raises:
        ModelError: the content is not XML, or is neither format.
    """
    if len(content) > _MOST_BYTES:
        raise ModelError(
            f"robot model {str(path)!r} has {len(content) / 1e6:.0f} MB; up to {_MOST_BYTES / 1e6:.0f} MB are read: is it a "
            "model of one robot? Meshes belong in files of their own"
        )
    try:
        root = ET.fromstring(content)
    except (ET.ParseError, ValueError) as error:
        kind = kind_of(path)
        what = f"{kind}, not URDF or MJCF" if kind in _OTHER_KINDS else f"is not valid XML: {error}"
        raise ModelError(f"robot model {str(path)!r} {what}") from error
    refuse_immense(root, path)
    sha256 = hashlib.sha256(content).hexdigest()
    if any("xacro}" in element.tag for element in root.iter()):
        raise ModelError(f"robot model {str(path)!r} is a xacro file; run xacro on it and use the URDF that it writes")
    sensors = _imu_sensor_frames(root)
    effort_limits, home = dict[str, float](), dict[str, float]()
    if root.tag == "robot":
        _refuse_non_finite_numbers(root, path)
        couplings, locked = couplings_of(root), fix_locked_joints(root, path)
        repairs = list(clean_urdf(root, path, base_link))
    elif root.tag == "mujoco":
        from equipoise.robot.cleaning.mjcf import clean_mjcf  # noqa: PLC0415 - most models are URDF

        try:
            root, repairs, effort_limits, home, locked, couplings = clean_mjcf(root, path)
        except ModelError:
            raise
        except ValueError as error:
            raise ModelError(f"robot model {str(path)!r}: {error}") from error
        _refuse_non_finite_numbers(root, path)
        base = root.find("worldbody/body")
        if base_link is not None and base is not None and base.get("name") != base_link:
            raise ModelError(
                f"robot model {str(path)!r}: base link {base_link!r} is not the body with the free joint, "
                f"{base.get('name')!r}"
            )
    else:
        raise ModelError(
            f"robot model {str(path)!r} starts with <{root.tag}>; expected <robot> (URDF; run xacro first on a .xacro file) "
            "or <mujoco> (MJCF)"
        )
    return ModelSource(
        path,
        "urdf" if root.tag == "robot" else "mjcf",
        ET.tostring(root, encoding="unicode"),
        sha256,
        (*repairs, *_of_joints(locked, couplings)),
        effort_limits,
        home,
        locked=locked,
        couplings=tuple(couplings),
        imu_sensors=sensors,
    )


def _of_joints(locked: dict[str, float], couplings: list[Coupling]) -> Iterator[str]:
    if locked:
        joints = ", ".join(f"{joint} at {position:g}" for joint, position in locked.items())
        yield f"joints whose lower and upper limits are equal are locked there: {joints}"
    if couplings:
        tied = ", ".join(f"{' with '.join(joints)} ({element})" for element, joints in couplings)
        yield f"couplings of locked joints are ignored: {tied}"


def _refuse_non_finite_numbers(root: ET.Element, path: Path, within: str = "") -> None:
    """Refuse NaN and infinity, with the name of the nearest element that has one."""
    if name := root.get("name"):
        within = f" of {name!r}"
    for key, value in root.attrib.items():
        for word in value.split():
            if word.lower().lstrip("+-") in ("nan", "inf", "infinity") and key not in ("name", "link", "joint"):
                raise ModelError(
                    f"robot model {str(path)!r}: <{root.tag}>{within} has {key}={value!r}; every number must be finite"
                )
    for element in root:
        _refuse_non_finite_numbers(element, path, within)


def _imu_sensor_frames(root: ET.Element) -> tuple[str, ...]:
    """Return the names of the links (URDF) or sites (MJCF) that the IMU sensors of a model file read."""
    found: list[str] = []
    for gazebo in root.findall("gazebo"):
        if any(_is_imu_sensor(element) for element in gazebo.iter()):
            found.append(gazebo.get("reference") or "")
            found += [(element.text or "").strip() for tag in ("bodyName", "frameName") for element in gazebo.iter(tag)]
    for section in root.findall("sensor"):
        found += [sensor.get("site") or "" for tag in ("gyro", "accelerometer") for sensor in section.findall(tag)]
        if _is_imu_sensor(section):  # of a URDF
            found += [parent.get("link") or "" for parent in section.findall("parent")]
    return tuple(dict.fromkeys(filter(None, found)))


def _is_imu_sensor(element: ET.Element) -> bool:
    kind, plugin = element.get("type", ""), element.get("filename", "")
    return (element.tag == "sensor" and kind in ("imu", "gazebo_imu")) or (element.tag == "plugin" and "_imu" in plugin)
