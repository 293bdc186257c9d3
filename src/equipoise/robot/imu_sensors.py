"""Which links or sites of a model file have an IMU sensor of Gazebo or MuJoCo."""

from __future__ import annotations

import xml.etree.ElementTree as ET


def imu_sensor_frames(root: ET.Element) -> tuple[str, ...]:
    """Names of the links (URDF) or sites (MJCF) that the IMU sensors of a model file read."""
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
