"""Estimate of the planar CoM during a search: two brackets, and the crossing of the planes within them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import reduce

import numpy as np

from equipoise.experiments.tilt import SupportPlane
from equipoise.method.reading import ComEstimate, LiftPlane
from equipoise.paper.bracket import Bracket, step
from equipoise.paper.equations import commanded_plane, find_intersection
from equipoise.paper.lift_trial import holds_lift_trial, read_lift_trial
from equipoise.paper.settings import ComSearchSettings
from equipoise.recording.recording import Recording
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.model import DIAGONALS, RobotModel
from equipoise.robot.stance import Stance


class SearchReading:
    """Implementation of `equipoise.method.reading.Reading`: each lift determines the side of its support line with the CoM."""

    def __init__(
        self, robot: RobotModel, stance: Stance, recordings: Sequence[Recording], settings: ComSearchSettings
    ) -> None:
        self._robot, self._stance, self._settings = robot, stance, settings
        self._lifts = {
            index: read_lift_trial(robot, recording, stance.joint_position)
            for index, recording in enumerate(recordings)
            if holds_lift_trial(recording)
        }

    def planes(self) -> list[LiftPlane]:
        """Return the planes measured by the robot's sensors."""
        return [
            LiftPlane(index, lift.trial.diagonal, lift.plane, lift.tilt.verdict) for index, lift in self._lifts.items()
        ]

    def estimate(self, trials: int) -> ComEstimate:
        """Return the crossing of the planes within the brackets, with its distance to the crossings of their ends."""
        brackets = {diagonal: self._bracket(diagonal, trials) for diagonal in DIAGONALS}
        height = float(composite_parameters(self._robot, self._stance.joint_position).com[2])
        planes = [self._end_planes(diagonal, bracket) for diagonal, bracket in brackets.items()]
        within = [
            bracket.plane or lower.towards(upper, 0.5)
            for bracket, (lower, upper) in zip(brackets.values(), planes, strict=True)
        ]
        com = find_intersection(within, height)
        corners = [find_intersection(corner, height) for corner in itertools.product(*planes)]
        half_width = np.abs(np.array(corners) - com).max(axis=0)
        bounds = {diagonal: (bracket.lower, bracket.upper) for diagonal, bracket in brackets.items()}
        return ComEstimate(trials, np.append(com, height), np.append(half_width, np.nan), None, bounds)

    def _bracket(self, diagonal: str, trials: int) -> Bracket:
        """Return the bracket after the first trials."""
        lifts = [lift for index, lift in self._lifts.items() if index < trials and lift.trial.diagonal == diagonal]
        return reduce(step, [lift.tried for lift in lifts], self._settings.bracket(self._stance))

    def _end_planes(self, diagonal: str, bracket: Bracket) -> list[SupportPlane]:
        """Return the planes at both ends, from the commanded feet if an end was not tried."""
        ends = ((bracket.lower, bracket.at_lower), (bracket.upper, bracket.at_upper))
        return [
            commanded_plane(self._stance, diagonal, offset) if tried is None or tried.plane is None else tried.plane
            for offset, tried in ends
        ]
