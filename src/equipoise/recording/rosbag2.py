"""Metadata with which rosbag2 reads a folder of MCAP files as one bag."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from equipoise.recording.log_messages import TYPES
from equipoise.recording.mcap_reader import MessageReader
from equipoise.user_file import write_file

METADATA = "metadata.yaml"
_VERSION = 5  # of the format: ROS 2 Humble's, which later ones read too


def write_metadata(folder: Path, files: Sequence[Path]) -> None:
    """Write the metadata of a bag; files without a message are not a part of it.

    Args:
        folder: folder of the bag.
        files: its files, in order.

    Raises:
        OutputError: the metadata cannot be written.
        RecordingError: a file cannot be read.
    """
    counts = Counter[str]()
    times: list[int] = []
    parts: list[dict[str, Any]] = []
    for path in files:
        messages = MessageReader(path).messages()
        if messages:
            counts.update(topic for topic, *_ in messages)
            times += (of_file := [time for _, _, time, _ in messages])
            parts.append({"path": path.name, **_span(of_file), "message_count": len(messages)})
    encoded = {"serialization_format": "cdr", "offered_qos_profiles": ""}
    topics = [
        {"topic_metadata": {"name": name, "type": kind, **encoded}, "message_count": counts[name]}
        for name, kind in TYPES.items()
    ]
    information = {
        "version": _VERSION,
        "storage_identifier": "mcap",
        **_span(times),
        "message_count": counts.total(),
        "topics_with_message_count": topics,
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [part["path"] for part in parts],
        "files": parts,
    }
    table = {"rosbag2_bagfile_information": information}
    write_file(folder / METADATA, json.dumps(table, indent=2) + "\n")  # JSON is YAML too


def _span(times: Sequence[int]) -> dict[str, Any]:
    """Return the first of some times and how long it is to the last [ns]."""
    start, end = min(times, default=0), max(times, default=0)
    return {"starting_time": {"nanoseconds_since_epoch": start}, "duration": {"nanoseconds": end - start}}
