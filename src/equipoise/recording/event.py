"""Events of an experiment, at moments of a recording."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from equipoise.errors import RecordingError
from equipoise.recording.clock import LONGEST, rounded


@dataclass(frozen=True)
class Event:
    """Event of an experiment: `name` with `data` (JSON values) at `time` [s]."""

    time: float
    name: str
    data: Mapping[str, Any] = field(default_factory=dict[str, Any])

    def __post_init__(self) -> None:
        if not abs(self.time) < LONGEST:
            raise RecordingError(f"event {self.name!r} is at {self.time:g} s; times must be finite and below 68 years")
        object.__setattr__(self, "time", float(rounded(np.asarray(self.time, dtype=float))))
        try:
            object.__setattr__(self, "data", json.loads(json.dumps(dict(self.data), allow_nan=False)))
        except (TypeError, ValueError) as error:
            raise RecordingError(f"event {self.name!r} has data that JSON cannot represent: {error}") from error


PHASE = "phase"
"""Name of the events that mark where a phase of a motion begins; data: {"name": ...}."""

TRIAL = "trial"
"""Name of the event that describes a recording's trial; data: kind, and the fields of the kind."""

BROKEN = "broken"
"""Name of the event that ends a recording whose motion was broken off."""
