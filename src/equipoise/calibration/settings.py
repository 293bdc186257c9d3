"""What a calibration does and how."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from equipoise.errors import SettingsError
from equipoise.experiments.sway import SwaySettings
from equipoise.paper.trial_runner import ComSearchSettings
from equipoise.precise.routine import PreciseSettings

Method = Literal["precise", "paper", "static"]
Feet = Literal["measured", "commanded"]
METHODS: tuple[Method, ...] = ("precise", "paper", "static")


@dataclass(frozen=True)
class CalibrationSettings:
    """What a calibration does and how.

    Attributes:
        method: "precise": 3-D CoM, mass and the whole inertia, with the sensors calibrated on the way;
            "paper": Algorithms 1 and 2, then equations 2 to 5; "static": CoM from the foot forces of the standing robot.
        feet: `paper` only: where support lines are taken to be: "measured" by the encoders and the accelerometer at rest,
            or "commanded", as printed in the paper.
        com_search: `paper`, step 1.
        sway: `paper`, step 2.
        precise: `precise`.
    """

    method: Method = "precise"
    feet: Feet = "measured"
    com_search: ComSearchSettings = field(default_factory=ComSearchSettings)
    sway: SwaySettings = field(default_factory=SwaySettings)
    precise: PreciseSettings = field(default_factory=PreciseSettings)

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise SettingsError(f"method {self.method!r} is not known; it is one of {', '.join(METHODS)}")
        if self.feet not in ("measured", "commanded"):
            raise SettingsError(f"feet are 'measured' or 'commanded', not {self.feet!r}")
