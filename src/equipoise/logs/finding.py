"""Findings in a log, in words."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LogFinding:
    """Something that was seen in a log, harmless or not, in a sentence about one of its parts."""

    about: str
    message: str
