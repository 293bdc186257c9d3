"""Recordings on disk: one NumPy archive each, exact to the last bit, without pickles."""

from __future__ import annotations

import contextlib
import json
import os
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from equipoise.errors import OutputError, RecordingError
from equipoise.recordings.recording import CommandStream, Event, ImuStream, JointStream, Recording

FORMAT = "equipoise.recording/1"


def save_recording(recording: Recording, path: Path) -> None:
    """Write a recording; the file appears under its name only when it is complete.

    Raises:
        OutputError: it cannot be written (no permission, disk full).
    """
    joints, imu, commands = recording.joints, recording.imu, recording.commands
    arrays: dict[str, NDArray[Any] | None] = {
        "joint_time": joints.time,
        "joint_position": joints.position,
        "joint_velocity": joints.velocity,
        "joint_torque": joints.torque,
        "imu_time": imu.time,
        "imu_angular_velocity": imu.angular_velocity,
        "imu_acceleration": imu.acceleration,
        "command_time": None if commands is None else commands.time,
        "command_position": None if commands is None else commands.position,
        "header": np.array(json.dumps(_header(recording))),
    }
    partial = path.with_suffix(".partial")
    try:
        with open(partial, "wb") as file:
            np.savez(file, allow_pickle=False, **{name: array for name, array in arrays.items() if array is not None})
        os.replace(partial, path)
    except OSError as error:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)
        raise OutputError(f"cannot write the recording {str(path)!r}: {error.strerror}") from error


def load_recording(path: Path) -> Recording:
    """Read a recording.

    Raises:
        RecordingError: the file is missing, damaged or of another format.
    """
    try:
        with open(path, "rb") as file:
            if not zipfile.is_zipfile(file):
                raise ValueError("it is no archive, or one that was cut short")
            file.seek(0)
            with np.load(file, allow_pickle=False) as archive:
                arrays: dict[str, NDArray[Any]] = dict(archive)
    except Exception as error:  # damaged and foreign files fail in many ways, not all of them typed
        raise RecordingError(f"the recording {str(path)!r} cannot be read: {error}") from error
    try:
        header = json.loads(str(arrays["header"]))
        found = header["format"]
    except (KeyError, TypeError, ValueError) as error:
        raise RecordingError(f"{str(path)!r} is no recording of equipoise: {error!r}") from error
    if found != FORMAT:
        raise RecordingError(f"the recording {str(path)!r} is {found!r}; this version reads {FORMAT!r}")
    try:
        commands = None
        if "command_time" in arrays:
            commands = CommandStream(arrays["command_time"], arrays["command_position"])
        return Recording(
            tuple(header["joint_names"]),
            JointStream(
                arrays["joint_time"],
                arrays["joint_position"],
                arrays.get("joint_velocity"),
                arrays.get("joint_torque"),
            ),
            ImuStream(arrays["imu_time"], arrays["imu_angular_velocity"], arrays["imu_acceleration"]),
            commands,
            tuple(Event(float(event["time"]), event["name"], dict(event["data"])) for event in header["events"]),
        )
    except RecordingError as error:
        raise RecordingError(f"the recording {str(path)!r} is damaged: {error}") from error
    except (KeyError, TypeError, ValueError) as error:
        raise RecordingError(f"the recording {str(path)!r} is damaged: {error!r}") from error


def _header(recording: Recording) -> dict[str, Any]:
    events = [{"time": event.time, "name": event.name, "data": dict(event.data)} for event in recording.events]
    return {"format": FORMAT, "joint_names": list(recording.joint_names), "events": events}
