"""Errors, as types that a caller can catch, with exit codes for scripts.

Every message states the problem, the value and the remedy. The command line returns the exit code of the error. The codes
are stable and are listed in docs/reference/cli.md.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any

UNHEALTHY, STOP_REQUESTED = 12, 13  # exit codes of StoppedError


def did_you_mean(name: str, options: Iterable[str]) -> str:
    """Return the nearest option, as a question for a message; empty if nothing is near."""
    from difflib import get_close_matches  # noqa: PLC0415 - most commands need it not

    near = get_close_matches(name, [*options], n=1)
    return f"did you mean {near[0]!r}? " if near else ""


def reason(error: Exception) -> str:
    """Return the text of an error for another one's message; errors of other packages need their type too."""
    return str(error) if isinstance(error, EquipoiseError) else repr(error)


class EquipoiseError(Exception):
    """Base of all errors that equipoise raises on purpose.

    Attributes:
        exit_code: exit code of the command line; 9: worker processes or machines are not available, or died.
        details: facts for scripts, as JSON values.
    """

    exit_code = 1
    details: Mapping[str, Any] = MappingProxyType({})

    def __init__(
        self, message: str = "", *, exit_code: int | None = None, details: Mapping[str, Any] | None = None
    ) -> None:
        super().__init__(message)
        if exit_code is not None:
            self.exit_code = exit_code
        if details is not None:
            self.details = details


class SettingsError(EquipoiseError, ValueError):
    """A value that the user chose (a flag, a setting, a payload, a description) cannot be used."""

    exit_code = 2


class ModelError(EquipoiseError, ValueError):
    """A robot model cannot be read, or is not a quadruped with inertia."""

    exit_code = 3


class MotionError(EquipoiseError, RuntimeError):
    """The robot cannot execute, or did not execute, a command, or its samples cannot be used.

    Attributes:
        recordings: recordings made before and while it went wrong, oldest first (Recording).
        other_commander: whether another program commands the motors, so that the robot is left to it.
    """

    exit_code = 4

    def __init__(
        self, message: str, recordings: tuple[Any, ...] = (), *, other_commander: bool = False, **given: Any
    ) -> None:
        super().__init__(message, **given)
        self.recordings, self.other_commander = recordings, other_commander


class ReachError(MotionError):
    """The robot cannot take a posture safely: out of reach, beyond a limit of a joint, in contact, or unstable."""


class FallError(MotionError):
    """The robot has fallen or is falling, or its base leans too far."""


class StoppedError(MotionError):
    """The run was ended although the robot still followed commands.

    Exit code `UNHEALTHY`: a hot motor, an empty battery, or a fault that the robot reports; `STOP_REQUESTED`: the operator
    stopped it by the remote control or the space bar; 4: this computer did not keep up with the control loop.
    """


class CommunicationError(MotionError, ConnectionError):
    """The robot or its process cannot be reached, does not answer, or has another version."""

    exit_code = 10


class RecordingError(EquipoiseError, ValueError):
    """A recording, log or run folder is damaged, lacks what an estimate needs, or cannot be resumed.

    Attributes:
        report: contents of a log that cannot be used (LogReport), or a mapping of columns to confirm (ColumnProposal).
    """

    exit_code = 5

    def __init__(self, message: str = "", report: Any = None, **given: Any) -> None:
        super().__init__(message, **given)
        self.report = report


class OutputError(EquipoiseError, OSError):
    """A result cannot be written to its destination."""

    exit_code = 6


class MissingDependencyError(EquipoiseError, ImportError):
    """An optional package is needed and not installed, or an installed package cannot be used."""

    exit_code = 7


class NotEstimatedError(EquipoiseError, ValueError):
    """A requested quantity was not estimated, is not identified, or is not physical."""

    exit_code = 8


class ModelWarning(UserWarning):
    """Something in a robot model was repaired or ignored."""
