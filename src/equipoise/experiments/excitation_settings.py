"""Settings of a sinusoidal excitation of the base."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from equipoise.errors import SettingsError

if TYPE_CHECKING:
    from equipoise.robot.stance import Stance

_PERIODS = 6
_FEWEST_PERIODS = 1.2


@dataclass(frozen=True)
class ExcitationSettings:
    """Motion of the base during the excitations.

    Attributes:
        amplitude: amplitude of the commanded rotation [rad].
        frequency: frequency of the excitation [Hz]; default 2 Hz on an A1, slower on larger robots.
        duration: duration of the steady part [s]; default six periods.
    """

    amplitude: float = 0.05
    frequency: float | None = None
    duration: float | None = None

    def __post_init__(self) -> None:
        for name, least, most in (("amplitude", 0.005, 0.5), ("frequency", 0.2, 10.0), ("duration", 0.1, 120.0)):
            value = getattr(self, name)
            if value is not None and not least <= value <= most:
                raise SettingsError(f"excitation {name} is {value}; it must be from {least} to {most}")

    def duration_for(self, stance: Stance) -> float:
        """Return the duration of the steady part [s]; raises SettingsError if it has too few periods."""
        frequency = self.frequency_for(stance)
        duration = self.duration or _PERIODS / frequency
        if duration * frequency < _FEWEST_PERIODS:
            raise SettingsError(
                f"an excitation of {duration} s at {frequency:.2f} Hz has {duration * frequency:.1f} periods; it needs "
                f"{_FEWEST_PERIODS} or more"
            )
        return duration

    def frequency_for(self, stance: Stance) -> float:
        """Return the given frequency, or the default for the stance's size [Hz]."""
        return self.frequency or 2.0 / stance.scale.time
