"""Everything that can go wrong, as types a caller can catch and a script can tell apart.

Every message says what is wrong, with what value, and what to do about it. The exit code is what the command line
returns for the error; the codes are stable and are listed in docs/reference/cli.md.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from types import MappingProxyType
from typing import Any


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return the nearest known name, as a question for a message; empty if nothing is near."""
    near = get_close_matches(name, [*known], n=1)
    return f"did you mean {near[0]!r}? " if near else ""


def reason(error: Exception) -> str:
    """Return the words of an error for another one's message; those of other programs need their type too."""
    return str(error) if isinstance(error, EquipoiseError) else repr(error)


class EquipoiseError(Exception):
    """Base of all errors that equipoise raises on purpose.

    Attributes:
        exit_code: what the command line returns; 9: worker processes or machines are not there, or died.
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


class UnconfirmedMassError(SettingsError):
    """The given mass disagrees with the joint torques, and was not confirmed.

    Attributes:
        comparison: both masses (MassComparison).
        details: the same as JSON values.
    """

    def __init__(self, message: str, comparison: Any = None, details: Mapping[str, Any] | None = None) -> None:
        super().__init__(message, details=details)
        self.comparison = comparison


class ModelError(EquipoiseError, ValueError):
    """A robot model cannot be read, or is not a quadruped with inertia."""

    exit_code = 3


class MotionError(EquipoiseError, RuntimeError):
    """The robot cannot do, or did not do, what was asked: a joint is beyond a limit, does not follow, or does not answer.

    Attributes:
        recordings: recordings made before and while it went wrong, oldest first (Recording).
    """

    exit_code = 4

    def __init__(
        self, message: str, recordings: tuple[Any, ...] = (), details: Mapping[str, Any] | None = None
    ) -> None:
        super().__init__(message, details=details)
        self.recordings = recordings


class ReachError(MotionError):
    """A posture is out of the legs' reach, joint limits or speed limits."""


class FallError(MotionError):
    """The robot fell when it should have stood."""


class SensorError(MotionError):
    """The robot's samples cannot be used: frozen, not a number, out of order."""


class OverrunError(MotionError):
    """This computer did not keep up with the control loop."""


class HealthError(MotionError):
    """The robot is sound and should not go on: a hot motor, an empty battery, a fault that it reports itself."""

    exit_code = 12


class StopRequestedError(MotionError):
    """The operator stopped the robot: by its remote control, or by the space bar."""

    exit_code = 13


class OtherCommanderError(MotionError):
    """Another program sends commands to the robot's motors."""


class CommunicationError(MotionError, ConnectionError):
    """The robot or its process cannot be reached, fell silent, or is of another version."""

    exit_code = 10


class RecordingError(EquipoiseError, ValueError):
    """A recording or run folder is damaged, lacks what an estimate needs, or cannot be resumed."""

    exit_code = 5


class ColumnsError(RecordingError):
    """A table's columns have other names than those that are read.

    Attributes:
        what: description of what the table lacks.
        proposal: TOML for --columns, as the names of the columns suggest.
        names: names of the table's columns.
        details: the proposal, for scripts.
    """

    def __init__(self, what: str, proposal: str = "", names: tuple[str, ...] = ()) -> None:
        remedy = ". Look through it, save it as columns.toml, and add --columns columns.toml:\n\n"
        super().__init__(f"{what}{remedy}{proposal}" if proposal else what)
        self.what, self.proposal, self.names = what, proposal, names
        self.details = {"columns": proposal}


class LogError(RecordingError):
    """The content of a log cannot be used.

    Attributes:
        report: what the log holds, piece by piece (LogReport).
        details: the same as JSON values.
    """

    def __init__(self, message: str, report: Any = None, details: Mapping[str, Any] | None = None) -> None:
        super().__init__(message, details=details)
        self.report = report


class OutputError(EquipoiseError, OSError):
    """A result cannot be written where it should go."""

    exit_code = 6


class MissingDependencyError(EquipoiseError, ImportError):
    """An optional package is needed and not installed, or an installed package cannot be used."""

    exit_code = 7


class NotEstimatedError(EquipoiseError, ValueError):
    """A quantity was asked for that was not estimated, is not identified, or that no body can have."""

    exit_code = 8


class ModelWarning(UserWarning):
    """Something in a robot model was repaired or ignored; the text says what."""
