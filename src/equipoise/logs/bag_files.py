"""Detection of bag files, without importing their readers."""

from __future__ import annotations

from pathlib import Path

ROS1 = ".bag"
_PARTS = (".mcap", ".db3")  # a .bag is a log of its own: several in a folder are several runs
SUFFIXES = (*_PARTS, ROS1)
METADATA = "metadata.yaml"


def is_bag(path: Path) -> bool:
    """Return whether a path looks like a bag: a folder of a ROS 2 bag, or one of its files."""
    if path.is_dir():
        return (path / METADATA).exists() or bool(bag_files(path))
    return path.suffix.lower() in SUFFIXES


def bag_files(path: Path) -> list[Path]:
    """Return the files of a ROS 2 bag in a folder; none if the path is not a folder."""
    return sorted(file for file in path.glob("*") if file.suffix in _PARTS) if path.is_dir() else []
