"""Findings in a log."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LogFinding:
    """Observation about one part of a log, harmless or not."""

    about: str
    message: str
