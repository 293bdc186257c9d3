"""Everything that can go wrong, as types a caller can catch and a script can tell apart.

Every message says what is wrong, with what value, and what to do about it. The exit code is what the command line
returns for the error; the codes are stable and are listed in docs/commands.md.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from types import MappingProxyType
from typing import Any


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """What somebody who mistyped a name may have meant, as a question for a message; empty if nothing is near."""
    near = get_close_matches(name, [*known], n=1)
    return f"did you mean {near[0]!r}? " if near else ""


class EquipoiseError(Exception):
    """Base of all errors that equipoise raises on purpose.

    Attributes:
        details: facts that a script may want to know besides, as JSON values.
    """

    exit_code = 1
    details: Mapping[str, Any] = MappingProxyType({})


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
        super().__init__(message)
        self.comparison = comparison
        self.details = details or {}


class ModelError(EquipoiseError, ValueError):
    """A robot model cannot be read, or is not a quadruped with inertia."""

    exit_code = 3


class MotionError(EquipoiseError, RuntimeError):
    """The robot cannot do, or did not do, what was asked.

    Attributes:
        recordings: recordings made before and while it went wrong, oldest first (Recording).
    """

    exit_code = 4

    def __init__(self, message: str, recordings: tuple[Any, ...] = ()) -> None:
        super().__init__(message)
        self.recordings = recordings


class ReachError(MotionError):
    """A posture is out of the legs' reach, joint limits or speed limits."""


class FallError(MotionError):
    """The robot fell when it should have stood."""


class TrackingError(MotionError, TimeoutError):
    """The joints did not come to rest near where they were sent."""


class BracketError(MotionError):
    """No support line between the search bounds balances the robot."""


class ImuMountingError(MotionError):
    """The tilts contradict the motions as they do when the IMU is mounted turned."""


class ResponseError(MotionError):
    """Joints or gyroscope did not answer a small motion as the model predicts.

    Attributes:
        details: commanded and measured angles and the likely cause, as JSON values.
    """

    def __init__(
        self, message: str, recordings: tuple[Any, ...] = (), details: Mapping[str, Any] = MappingProxyType({})
    ) -> None:
        super().__init__(message, recordings)
        self.details = details


class LimitError(MotionError):
    """A joint is, or was sent, beyond what it may do: position, speed, torque or temperature."""


class SensorError(MotionError):
    """The robot's samples cannot be believed: frozen, not a number, out of order."""


class OverrunError(MotionError):
    """This computer did not keep up with the control loop."""


class HealthError(LimitError):
    """The robot is sound and should not go on: a hot motor, an empty battery, a fault that it reports itself."""

    exit_code = 12


class StopRequestedError(MotionError):
    """The operator stopped the robot: by its remote control, or by the space bar."""

    exit_code = 13


class RobotProcessError(MotionError):
    """The robot process ended, stopped or is of another version."""

    exit_code = 10


class OtherCommanderError(MotionError):
    """Another program sends commands to the robot's motors."""


class CommunicationError(MotionError, ConnectionError):
    """The robot cannot be reached, or fell silent."""

    exit_code = 10


class RecordingError(EquipoiseError, ValueError):
    """A recording or run folder is damaged, or lacks what an estimate needs."""

    exit_code = 5


class ResumeError(RecordingError):
    """A run that was interrupted cannot be gone on with: what it would do now is not what was recorded."""


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
    """What is in a log cannot be used.

    Attributes:
        report: what the log holds, piece by piece (LogReport).
        details: the same as JSON values.
    """

    def __init__(self, message: str, report: Any = None, details: Mapping[str, Any] | None = None) -> None:
        super().__init__(message)
        self.report = report
        self.details = details or {}


class OutputError(EquipoiseError, OSError):
    """A result cannot be written where it should go."""

    exit_code = 6


class MissingDependencyError(EquipoiseError, ImportError):
    """An optional package is needed and not installed."""

    exit_code = 7


class PluginError(MissingDependencyError):
    """What an installed package adds to equipoise cannot be imported, or is something else."""


class NotEstimatedError(EquipoiseError, ValueError):
    """A quantity was asked for that the method used does not estimate."""

    exit_code = 8


class NotIdentifiedError(NotEstimatedError):
    """A quantity was asked for that the run told too little of."""


class NotPhysicalError(EquipoiseError, ValueError):
    """What would be written are inertial parameters that no body can have."""

    exit_code = 8


class WorkerError(EquipoiseError, RuntimeError):
    """Processes or machines that should do the work are not there, or died."""

    exit_code = 9


class ModelWarning(UserWarning):
    """Something in a robot model was repaired or ignored; the text says what."""
