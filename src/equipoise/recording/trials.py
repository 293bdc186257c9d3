"""Trials: the kinds of motion that a recording may hold.

A commanded trial is written into a recording as the data of one event, `{"kind": "lift", "diagonal": "FL_RR", ...}`, and
`Recording.trial` reads it from there. A trial found in a log is `Recording.found_trial`. The phases of its recording
determine how far it came: `Recording.complete`, `refused`, or interrupted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from itertools import combinations
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
        starts_with: name of the phase in which the trial proper begins; before it, the trial may be refused.
        complete_with: name of the phase that begins once the trial has reached its purpose.
        found_at: time in a log in which the trial was found, None if we commanded it [s].
    """

    kind: ClassVar[str]
    starts_with: ClassVar[str]
    complete_with: ClassVar[str]
    found_at: float | None = None

    @property
    def about(self) -> str:
        """Return the diagonal or the axis; empty if there is none."""
        return ""

    def to_data(self) -> dict[str, Any]:
        """Return the kind and all fields that are not None, for an event."""
        return {"kind": self.kind, **{name: value for name, value in asdict(self).items() if value is not None}}


@dataclass(frozen=True, kw_only=True)
class LiftTrial(RecordedTrial):
    """Lift of two diagonal feet; one found in a log has no other fields.

    Attributes:
        diagonal: diagonal that the robot stands on, "FL_RR" or "FR_RL".
    """

    kind: ClassVar[str] = "lift"
    starts_with: ClassVar[str] = Phase.UNLOAD
    complete_with: ClassVar[str] = Phase.LOWER
    diagonal: str

    def __post_init__(self) -> None:
        if self.diagonal not in DIAGONALS:
            raise ValueError(f"{self.diagonal!r} is not a diagonal")

    @property
    def about(self) -> str:
        return self.diagonal


@dataclass(frozen=True, kw_only=True)
class CommandedLift(LiftTrial):
    """Commanded lift.

    Attributes:
        offset: shift of the support line from where it is at the nominal stance, along the base's x axis [m].
        lift_height: commanded height of the lifted feet [m].
        tilt_threshold: smallest rotation that counts as a tilt [rad].
    """

    offset: float
    lift_height: float
    tilt_threshold: float


def meanwhile(turn: Axis | None, swing: Swing | None) -> str:
    """Return the name of the motion on two feet: of its swing or rotation, or "passive"."""
    return f"swing {swing}" if swing else turn or "passive"


@dataclass(frozen=True, kw_only=True)
class DesignedLift(CommandedLift):
    """Lift of the Bayesian method: in a posture, on a side of the CoM, optionally with a rotation of the body.

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
        for field_name, value, allowed in (("turn", self.turn, AXES), ("swing", self.swing, SWINGS)):
            if value not in (None, *allowed):
                raise ValueError(f"{value!r} is not a {field_name}; those are {', '.join(allowed)}")

    @property
    def meanwhile(self) -> str:
        """Return the name of the motion of the robot on two feet, as `meanwhile` does."""
        return meanwhile(self.turn, self.swing)


@dataclass(frozen=True, kw_only=True)
class PostureTrial(RecordedTrial):
    """Stance motion from rest to rest.

    Attributes:
        posture: posture of the base at its end; None if it was found in a log.
    """

    kind: ClassVar[str] = "posture"
    starts_with: ClassVar[str] = Phase.MOVE
    complete_with: ClassVar[str] = Phase.REST
    posture: BodyPosture | None = None


@dataclass(frozen=True, kw_only=True)
class ExcitationTrial(RecordedTrial):
    """Excitation: the base oscillates on four feet.

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
    """Rest on four feet."""

    kind: ClassVar[str] = "stand"
    starts_with: ClassVar[str] = Phase.MOVE
    complete_with: ClassVar[str] = Phase.REST


_STANDING = (*PAIRS.values(), *combinations(LEG_NAMES, 3))


@dataclass(frozen=True)
class Step:
    """Time in which a walking robot stands on two feet or three.

    Attributes:
        standing: names of the legs whose feet stand, in the order of LEG_NAMES.
        start, end: times at which it begins and ends [s].
    """

    standing: tuple[str, ...]
    start: float
    end: float

    def __post_init__(self) -> None:
        if self.standing not in _STANDING:
            raise ValueError(f"{', '.join(self.standing)} are not two or three legs in the order {' '.join(LEG_NAMES)}")

    @property
    def pair(self) -> str:
        """Return the name of the two feet that stand, one of PAIRS."""
        return "_".join(self.standing)

    @property
    def lifted(self) -> str:
        """Return the name of the first leg whose foot is up, the only one of a step on three feet."""
        return next(leg for leg in LEG_NAMES if leg not in self.standing)


@dataclass(frozen=True, kw_only=True)
class SteppingTrial(RecordedTrial):
    """Steps of a robot, found in a log.

    Attributes:
        feet: number of feet that stand in a step.
        steps: times in which feet are up.
    """

    starts_with: ClassVar[str] = Phase.WALK
    complete_with: ClassVar[str] = Phase.END
    feet: ClassVar[int]
    steps: tuple[Step, ...]

    def __post_init__(self) -> None:
        if any(len(step.standing) != self.feet for step in self.steps):
            raise ValueError(f"a {self.kind} has steps on {self.feet} feet")

    @property
    def duration(self) -> float:
        """Return the time from the first step's start to the last one's end, without the margins [s]."""
        return self.steps[-1].end - self.steps[0].start if self.steps else 0.0


@dataclass(frozen=True, kw_only=True)
class WalkTrial(SteppingTrial):
    """Walk with two feet on the floor at a time.

    Attributes:
        heading: heading at the start of the walk, relative to the start of the log, positive to the left [rad].
    """

    kind: ClassVar[str] = "walk"
    feet: ClassVar[int] = 2
    heading: float


@dataclass(frozen=True, kw_only=True)
class CrawlTrial(SteppingTrial):
    """Crawl: one foot is moved after the other."""

    kind: ClassVar[str] = "crawl"
    feet: ClassVar[int] = 3


@dataclass(frozen=True, kw_only=True)
class TurnTrial(RecordedTrial):
    """Rotation by hand: the robot lies down, the operator turns it to face the other way, and it stands up."""

    kind: ClassVar[str] = "turn"
    starts_with: ClassVar[str] = Phase.LIE
    complete_with: ClassVar[str] = Phase.REST


@dataclass(frozen=True, kw_only=True)
class MotorTrial(RecordedTrial):
    """Motion of the joints: all at once while the robot lies with its legs up, or one leg's while it stands on three feet.

    Attributes:
        kp, kd: gains of the joints that swing [Nm/rad], [Nm s/rad]; None: the platform's own, which are not available.
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
    """Return the trial in an event's data; None for an unknown kind.

    Raises:
        RecordingError: a value of the kind is missing, or not allowed.
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
