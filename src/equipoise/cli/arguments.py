"""Arguments that are read before parsing. This module imports no NumPy, robot model or verb."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path

from equipoise.calibration.run_header import NEEDED, read_header
from equipoise.robot.catalog import find_model, read_model_file

_ROBOT_FIRST = ("audit", "calibrate", "doctor", "plan", "record", "payload", "lab balance", "lab monte-carlo")
NEEDED_OR_LOG = f"{NEEDED}, or pass --robot ROBOT for a log of another program"
_RUN_OR_LOG_FIRST = ("diagnose", "estimate", "view", "lab validate")
_RUN_FIRST = (*_RUN_OR_LOG_FIRST, "compare", "export", "report")


def chosen(words: Sequence[str], flag: str, default: str) -> str:
    """Return the last value of a flag on which other flags depend."""
    value = default
    for index, word in enumerate(words):
        if word == flag and index + 1 < len(words):
            value = words[index + 1]
        elif word.startswith(f"{flag}="):
            value = word.partition("=")[2]
    return value


def refuse_missing(verb: str, words: Sequence[str]) -> None:
    """Raise if a robot or run does not exist, before the verb is imported, which takes a second.

    Args:
        verb: verb, or group and verb as "lab balance".
        words: words that follow it: robots and runs before the first flag, and a robot after --robot.

    Raises:
        ModelError: a robot does not exist.
        RecordingError: a run does not exist.
    """
    if {"-h", "--help"} & {*words} or chosen(words, "--format", "") == "github":  # which annotates missing files
        return
    first = [*takewhile(lambda word: not word.startswith("-"), words)]
    robot = chosen(words, "--robot", "")
    for name in first if verb in _ROBOT_FIRST else [robot] if robot and verb in _RUN_FIRST else ():
        read_model_file(find_model(name)[0])
    for path in map(Path, first if verb in _RUN_FIRST and not robot else ()):
        if not path.exists():
            read_header(path, NEEDED_OR_LOG if verb in _RUN_OR_LOG_FIRST else NEEDED)
