"""What rosbag2 wants beside an MCAP file to take the folder for a bag."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from equipoise.recording.mcap_writer import McapWriter
from equipoise.user_file import write_file

METADATA = "metadata.yaml"
_VERSION = 5  # of the format: ROS 2 Humble's, which later ones read too


def write_metadata(folder: Path, file: McapWriter) -> None:
    """Write the metadata of a bag of one file that lies in the folder.

    Raises:
        OutputError: it cannot be written.
    """
    write_file(folder / METADATA, json.dumps(_metadata(file), indent=2) + "\n")  # JSON is YAML too


def _metadata(file: McapWriter) -> dict[str, Any]:
    start, end = file.time_range
    span = {"starting_time": {"nanoseconds_since_epoch": start}, "duration": {"nanoseconds": end - start}}
    counts = file.message_counts
    count = sum(counts.values())
    topics = [
        {
            "topic_metadata": {
                "name": topic.name, "type": topic.type, "serialization_format": "cdr", "offered_qos_profiles": "",
            },
            "message_count": counts[topic.name],
        }
        for topic in file.topics
    ]  # fmt: skip
    information = {
        "version": _VERSION,
        "storage_identifier": "mcap",
        **span,
        "message_count": count,
        "topics_with_message_count": topics,
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.path.name],
        "files": [{"path": file.path.name, **span, "message_count": count}],
    }
    return {"rosbag2_bagfile_information": information}
