"""Estimates of the CoM after each trial of a run, with the run's method."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from contextlib import suppress

import numpy as np

from equipoise.errors import EquipoiseError
from equipoise.method.method import Method
from equipoise.method.reading import ComEstimate, LiftPlane, Reading
from equipoise.recording.recording import Recording
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance


def estimates(
    robot: RobotModel, stance: Stance, method: Method, recordings: list[Recording]
) -> Iterator[tuple[ComEstimate, Sequence[LiftPlane]] | None]:
    """Yield the estimate after each trial that allows one, with support planes; None while waiting for a trial.

    Args:
        recordings: complete trials so far; the caller appends more.
    """
    reading: Reading | None = None
    read = 0
    for count in itertools.count(1):
        while len(recordings) < count:
            yield None
        with suppress(EquipoiseError, np.linalg.LinAlgError):  # the run's own result states why there is none
            if count > read:
                given, reading = recordings[:], None
                reading, read = method.reading(robot, stance, given), len(given)
            if reading is not None:
                yield reading.estimate(count), [plane for plane in reading.planes() if plane.trial < count]
