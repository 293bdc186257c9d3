"""True state of a simulated robot, which its own sensors do not measure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from equipoise.conventions import FloatArray


@dataclass(frozen=True, eq=False)
class GroundTruth:
    """The true state at one moment, in axes of the floor: z is its normal, the floor is at z = 0.

    Attributes:
        time: time by the platform's clock [s].
        feet: (4, 3) centres of the feet FL FR RL RR in the world [m].
        clearance: (4,) distances between the feet's spheres and the floor; negative: pressed into it [m].
        com: (3,) centre of mass of the whole robot in the world [m].
        up: (3,) unit vector against gravity.
        tilt: angle of the base's z axis from up [rad].
    """

    time: float
    feet: FloatArray
    clearance: FloatArray
    com: FloatArray
    up: FloatArray
    tilt: float


class GroundTruthRecorder:
    """Recorder of the true state every few control periods.

    Attributes:
        ground_truths: recorded states in order of time.
    """

    def __init__(self, look: Callable[[], GroundTruth], every: int) -> None:
        self.ground_truths: list[GroundTruth] = []
        self._look, self._every, self._count = look, every, 0

    def watch(self) -> None:
        """Record the state if it is due; call once every control period."""
        if self._count % self._every == 0:
            self.ground_truths.append(self._look())
        self._count += 1
