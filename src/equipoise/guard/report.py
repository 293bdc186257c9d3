"""Report of a guarded run."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from equipoise.guard.sample_filter import SampleCounts

if TYPE_CHECKING:
    from equipoise.platform.platform import RobotState


@dataclass
class GuardReport:
    """Report of a guarded run.

    Attributes:
        samples: counts of samples that arrived.
        commands: number of sent commands.
        overruns: number of commands more than a millisecond late; None in simulation.
        stalls: number of deadlines without a command; None in simulation.
        latest: largest lateness of a command [s]; None in simulation.
        late_999: 99.9 % quantile of the commands' lateness [s]; None in simulation.
        largest_tilt: largest angle of the base from upright [rad].
        hottest_motor: highest motor temperature [deg C]; None if not reported.
        lowest_voltage: lowest battery voltage [V]; None if not reported.
        work: median processor time of a control period [s]; None in simulation.
        unchecked: whether samples with wrong checksums were accepted.
        realtime: real-time privileges that the system granted, in words; empty in simulation.
        ending: steps of the ending, in order; the last is "released" if the platform released the robot.
        trouble: error that ended the run, or empty.
    """

    samples: SampleCounts = field(default_factory=SampleCounts)
    commands: int = 0
    overruns: int | None = None
    stalls: int | None = None
    latest: float | None = None
    late_999: float | None = None
    largest_tilt: float = 0.0
    hottest_motor: float | None = None
    lowest_voltage: float | None = None
    work: float | None = None
    unchecked: bool = False
    realtime: str = ""
    ending: tuple[str, ...] = ()
    trouble: str = ""

    def note(self, state: RobotState) -> None:
        """Add the state after a command."""
        self.commands += 1
        if state.health is None:
            return
        if state.health.motor_temperature is not None:
            self.hottest_motor = max(self.hottest_motor or -np.inf, float(state.health.motor_temperature.max()))
        if state.health.battery_voltage is not None:
            self.lowest_voltage = min(self.lowest_voltage or np.inf, state.health.battery_voltage)
