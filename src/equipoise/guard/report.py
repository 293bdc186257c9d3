"""What a guarded run was like."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from equipoise.drivers.hardware import LoopTiming
from equipoise.guard.sample_watch import SampleCounts
from equipoise.platform.platform import Platform, RobotState


@dataclass(frozen=True)
class GuardReport:
    """What a guarded run was like.

    Attributes:
        samples: what arrived.
        commands: how many were sent.
        overruns: how many of them more than a millisecond late; None in simulation.
        stalls: how often deadlines passed without a command; None in simulation.
        late_999: lateness that 99.9 % of the commands stayed below [s]; None in simulation.
        largest_tilt: of the base from upright [rad].
        hottest_motor: [deg C]; None if motors do not say.
        lowest_voltage: of the battery [V]; None if it does not say.
        ending: what the safe ending did, in order; the last is "released" if the platform let go of the robot.
        trouble: what ended the run while nobody moved the robot; or empty. A result may have come of it all the same.
    """

    samples: SampleCounts
    commands: int
    overruns: int | None
    stalls: int | None
    late_999: float | None
    largest_tilt: float
    hottest_motor: float | None
    lowest_voltage: float | None
    ending: tuple[str, ...]
    trouble: str = ""


class Vitals:
    """The extremes of a robot's health."""

    def __init__(self) -> None:
        self.commands = 0
        self._hottest: float | None = None
        self._lowest: float | None = None

    def note(self, state: RobotState) -> None:
        """A state that a command was answered with."""
        self.commands += 1
        if state.health is None:
            return
        if state.health.motor_temperature is not None:
            self._hottest = max(self._hottest or -np.inf, float(state.health.motor_temperature.max()))
        if state.health.battery_voltage is not None:
            self._lowest = min(self._lowest or np.inf, state.health.battery_voltage)

    def report(
        self, platform: Platform, counts: SampleCounts, largest_tilt: float, ending: tuple[str, ...]
    ) -> GuardReport:
        """With what others know."""
        late = overruns = stalls = None
        timing = getattr(platform, "timing", None)
        if isinstance(timing, LoopTiming) and len(timing.lateness):
            late, overruns, stalls = float(np.quantile(timing.lateness, 0.999)), timing.overruns, timing.lost
        return GuardReport(
            replace(counts), self.commands, overruns, stalls, late, largest_tilt, self._hottest, self._lowest, ending
        )
