"""Trials: what a recording says that it is.

A commanded trial is written into a recording as the data of one event, `{"kind": "lift", "diagonal": "FL_RR", ...}`, and
`Recording.trial` reads it from there. A trial found in a log is `Recording.found_trial`. How far a trial came is said by the
phases in its recording: `Recording.complete`, `interrupted`, `refused`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, ClassVar

from equipoise.conventions import AXES, SWINGS, Axis, Swing
from equipoise.errors import RecordingError
from equipoise.json_form import from_json
from equipoise.recording.phases import Phase
from equipoise.robot.model import DIAGONALS, LEG_NAMES, PAIRS
from equipoise.robot.posture import BodyPosture


@dataclass(frozen=True, kw_only=True)
class RecordedTrial:
    """Base of all trials.

    Attributes:
        kind: kind of trial, "lift", "posture", "excitation", "stand", "walk", "crawl", "turn" or "motors".
        starts_with: name of the phase with which the robot does what the trial is for; before it, it may be refused.
        complete_with: name of the phase that begins once the trial has shown what it is for.
        found_at: time in a log in which the trial was found, None if we commanded it [s].
    """

    kind: ClassVar[str]
    starts_with: ClassVar[str]
    complete_with: ClassVar[str]
    found_at: float | None = None

    @property
    def about(self) -> str:
        """The diagonal or the axis; empty if there is none."""
        return ""

    def to_data(self) -> dict[str, Any]:
        """Return the kind and all fields that are not None, for an event."""
        return {"kind": self.kind, **{name: value for name, value in asdict(self).items() if value is not None}}


@dataclass(frozen=True, kw_only=True)
class LiftTrial(RecordedTrial):
    """Two diagonal feet are lifted; of a lift found in a log no more is known.

    Attributes:
        diagonal: diagonal that the robot stands on, "FL_RR" or "FR_RL".
    """

    kind: ClassVar[str] = "lift"
    starts_with: ClassVar[str] = Phase.UNLOAD
    complete_with: ClassVar[str] = Phase.LOWER
    diagonal: str

    def __post_init__(self) -> None:
        if self.diagonal not in DIAGONALS:
            raise ValueError(f"no diagonal is called {self.diagonal!r}")

    @property
    def about(self) -> str:
        return self.diagonal


@dataclass(frozen=True, kw_only=True)
class CommandedLift(LiftTrial):
    """A lift that we commanded.

    Attributes:
        offset: shift of the support line from where it is at the nominal stance, along the base's x axis [m].
        lift_height: commanded height of the lifted feet [m].
        tilt_threshold: smallest rotation that counts as a tilt [rad].
    """

    offset: float
    lift_height: float
    tilt_threshold: float


MEANWHILE = ("passive", *AXES, *(f"swing {direction}" for direction in SWINGS))
"""Words for the motions of a robot on two feet."""


def meanwhile(turn: Axis | None, swing: Swing | None) -> str:
    """One of MEANWHILE."""
    return f"swing {swing}" if swing else turn or "passive"


@dataclass(frozen=True, kw_only=True)
class DesignedLift(CommandedLift):
    """A lift of the Bayesian method: in a posture, on a side of the CoM, perhaps with a turn of the body.

    Attributes:
        posture: posture of the base.
        side: side of the CoM on which the line is: 1 ahead, -1 behind, 0 under it.
        turn: rotation of the body about its own CoM while on two feet, or None.
        swing: direction in which the lifted feet swing meanwhile, or None.
    """

    posture: BodyPosture
    side: int
    turn: Axis | None = None
    swing: Swing | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        for what, called, known in (("turn", self.turn, AXES), ("swing", self.swing, SWINGS)):
            if called not in (None, *known):
                raise ValueError(f"no {what} is called {called!r}")

    @property
    def meanwhile(self) -> str:
        """Motion of the robot on two feet, one of MEANWHILE."""
        return meanwhile(self.turn, self.swing)


@dataclass(frozen=True, kw_only=True)
class PostureTrial(RecordedTrial):
    """A move over planted feet, from rest to rest.

    Attributes:
        posture: posture of the base at its end; None if it was found in a log.
    """

    kind: ClassVar[str] = "posture"
    starts_with: ClassVar[str] = Phase.MOVE
    complete_with: ClassVar[str] = Phase.REST
    posture: BodyPosture | None = None


@dataclass(frozen=True, kw_only=True)
class ExcitationTrial(RecordedTrial):
    """The base oscillates over planted feet.

    Attributes:
        frequencies: frequencies by the axes about which the base turns [Hz].
        amplitude: commanded rotation about a single axis [rad]; None: about all axes at once, or found in a log.
    """

    kind: ClassVar[str] = "excitation"
    starts_with: ClassVar[str] = Phase.RAMP
    complete_with: ClassVar[str] = Phase.END
    frequencies: Mapping[Axis, float] = field(default_factory=dict[Axis, float])
    amplitude: float | None = None

    def __post_init__(self) -> None:
        if not self.frequencies.keys() <= set(AXES):
            raise ValueError(f"no axes are called {', '.join(self.frequencies)}")

    @property
    def about(self) -> str:
        return "all" if self.amplitude is None else next(iter(self.frequencies))


@dataclass(frozen=True, kw_only=True)
class StandTrial(RecordedTrial):
    """The robot stands still on four feet."""

    kind: ClassVar[str] = "stand"
    starts_with: ClassVar[str] = Phase.MOVE
    complete_with: ClassVar[str] = Phase.REST


@dataclass(frozen=True)
class TwoFeet:
    """A time in which a robot that walks stands on two feet.

    Attributes:
        pair: name of the two feet, one of PAIRS.
        start, end: times at which it begins and ends [s].
    """

    pair: str
    start: float
    end: float

    def __post_init__(self) -> None:
        if self.pair not in PAIRS:
            raise ValueError(f"no two feet are called {self.pair!r}")

    @property
    def standing(self) -> tuple[str, ...]:
        """Names of the legs whose feet stand."""
        return PAIRS[self.pair]


@dataclass(frozen=True)
class ThreeFeet:
    """A time in which a robot that walks stands on three feet.

    Attributes:
        lifted: name of the leg whose foot is up.
        start, end: times at which it begins and ends [s].
    """

    lifted: str
    start: float
    end: float

    def __post_init__(self) -> None:
        if self.lifted not in LEG_NAMES:
            raise ValueError(f"no leg is called {self.lifted!r}")

    @property
    def standing(self) -> tuple[str, ...]:
        """Names of the legs whose feet stand."""
        return tuple(leg for leg in LEG_NAMES if leg != self.lifted)


@dataclass(frozen=True, kw_only=True)
class SteppingTrial(RecordedTrial):
    """The robot takes steps; found in a log.

    Attributes:
        steps: times in which feet are up.
    """

    starts_with: ClassVar[str] = Phase.WALK
    complete_with: ClassVar[str] = Phase.END
    steps: tuple[TwoFeet, ...] | tuple[ThreeFeet, ...]

    @property
    def duration(self) -> float:
        """From the first step's begin to the last one's end; the recording holds some time around it [s]."""
        return self.steps[-1].end - self.steps[0].start if self.steps else 0.0


@dataclass(frozen=True, kw_only=True)
class WalkTrial(SteppingTrial):
    """The robot walks on two feet at a time.

    Attributes:
        steps: times on two feet.
        heading: angle by which the robot had turned since the log began when the walk does, to its left [rad].
    """

    kind: ClassVar[str] = "walk"
    steps: tuple[TwoFeet, ...]
    heading: float


@dataclass(frozen=True, kw_only=True)
class CrawlTrial(SteppingTrial):
    """The robot walks one foot after the other.

    Attributes:
        steps: times on three feet.
    """

    kind: ClassVar[str] = "crawl"
    steps: tuple[ThreeFeet, ...]


@dataclass(frozen=True, kw_only=True)
class TurnTrial(RecordedTrial):
    """The robot lies down, the operator turns it to face the other way, and it stands up."""

    kind: ClassVar[str] = "turn"
    starts_with: ClassVar[str] = Phase.LIE
    complete_with: ClassVar[str] = Phase.REST


@dataclass(frozen=True, kw_only=True)
class MotorTrial(RecordedTrial):
    """The robot swings all joints at once, lying with its legs up; or those of one leg, standing on its other three feet.

    Attributes:
        kp, kd: gains of the joints that swing, meanwhile [Nm/rad], [Nm s/rad]; None: the platform's own, which are not known.
        leg: name of the leg that swings while the others stand; None: all do.
    """

    kind: ClassVar[str] = "motors"
    starts_with: ClassVar[str] = Phase.RAMP
    complete_with: ClassVar[str] = Phase.END
    kp: float | None = None
    kd: float | None = None
    leg: str | None = None

    def __post_init__(self) -> None:
        if self.leg not in (None, *LEG_NAMES):
            raise ValueError(f"no leg is called {self.leg!r}")

    @property
    def about(self) -> str:
        return self.leg or ""


def read_trial(data: Mapping[str, Any]) -> RecordedTrial | None:
    """Return the trial that the data of its event describe; None if it is of a kind that is not ours.

    Raises:
        RecordingError: a value that belongs to the kind is missing, or not allowed.
    """
    kind = next((kind for kind in _KINDS if kind.kind == data.get("kind")), None)
    if kind is None:
        return None
    if kind is LiftTrial and "offset" in data:
        kind = DesignedLift if "posture" in data else CommandedLift
    try:
        return from_json(kind, {name: value for name, value in data.items() if name != "kind" and value is not None})
    except ValueError as error:
        raise RecordingError(
            f"the recording's trial {dict(data)} is damaged: {error}; leave the recording out"
        ) from error


_KINDS = (LiftTrial, PostureTrial, ExcitationTrial, StandTrial, WalkTrial, CrawlTrial, TurnTrial, MotorTrial)
