"""How the CoM estimate closes in: what was known after each trial, by the method's own arithmetic.

precise: the posterior of all trials so far, in three dimensions. paper: the two brackets, and where their middles cross.
"""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import TypeVar

import numpy as np

from equipoise.calibration.settings import CalibrationSettings
from equipoise.conventions import FloatArray
from equipoise.errors import EquipoiseError
from equipoise.experiments.tilt import SupportPlane
from equipoise.paper.bracket import Bracket, step
from equipoise.paper.equations import between, commanded_plane, find_intersection
from equipoise.paper.lift_trial import holds_lift_trial, read_lift_trial
from equipoise.paper.trial_runner import shifted_feet
from equipoise.precise.measurements.evidence import RunEvidence, read_evidence
from equipoise.precise.measurements.support_planes import centre_shift
from equipoise.precise.posterior import estimate_posterior
from equipoise.recording.recording import Recording
from equipoise.result.statistics import NORMAL_95
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.model import DIAGONALS, RobotModel
from equipoise.robot.stance import Stance

Answer = TypeVar("Answer")


@dataclass(frozen=True, eq=False)
class LiftPlane:
    """What one lift says: a plane in the base frame at the nominal stance.

    Attributes:
        trial: index of the recording.
        diagonal: that the robot stood on.
        point: (3,) on it [m]. precise: where the lift puts the CoM; paper: on the support line.
        normal: (3,) unit, forward.
        verdict: paper: which way the robot tipped, so on which side the CoM is; None: the plane holds the CoM.
    """

    trial: int
    diagonal: str
    point: FloatArray
    normal: FloatArray
    verdict: str | None = None


@dataclass(frozen=True, eq=False)
class ComEstimate:
    """What is known of the CoM after so many trials.

    Attributes:
        trials: complete recordings that it is from.
        com: (3,) of the whole robot at the nominal stance, in the base frame [m].
        half: (3,) 95 % interval to either side, or half the bracket [m]; nan where the method does not estimate it.
        covariance: (3, 3) [m2], or None.
        brackets: of the offset, by diagonal [m]; precise: none.
    """

    trials: int
    com: FloatArray
    half: FloatArray
    covariance: FloatArray | None
    brackets: dict[str, tuple[float, float]]


class _Precise:
    """The precise method's reading of trials."""

    def __init__(
        self, robot: RobotModel, stance: Stance, settings: CalibrationSettings, recordings: Sequence[Recording]
    ) -> None:
        self._robot, self._stance, self._settings = robot, stance, settings.precise
        self._motions = read_evidence(robot, stance, recordings).motions

    def planes(self) -> list[LiftPlane]:
        """With everything else by the model."""
        com = composite_parameters(self._robot, self._stance.joint_position).com
        lifts = [(motion.index, motion.lift) for motion in self._motions if motion.lift]
        shifts = [(index, lift.diagonal, centre_shift(self._robot, lift)) for index, lift in lifts]
        return [
            LiftPlane(index, diagonal, com + shift.distance * shift.normal, shift.normal)
            for index, diagonal, shift in shifts
        ]

    def estimate(self, trials: int) -> ComEstimate:
        """The posterior of the first trials."""
        motions, settings = self._motions[:trials], self._settings
        posterior = estimate_posterior(
            self._robot, self._stance, RunEvidence(motions), settings.priors, settings.scale,
            lifts_needed=any(motion.lift for motion in motions),
        )  # fmt: skip
        covariance = posterior.robot_covariance[1:4, 1:4]
        return ComEstimate(trials, posterior.robot_body.com, NORMAL_95 * np.sqrt(np.diag(covariance)), covariance, {})


class _Paper:
    """The paper's reading of trials: which side of the support line the CoM is on."""

    def __init__(
        self, robot: RobotModel, stance: Stance, settings: CalibrationSettings, recordings: Sequence[Recording]
    ) -> None:
        self._robot, self._stance, self._settings = robot, stance, settings.com_search
        self._lifts = {
            index: read_lift_trial(robot, recording, stance.joint_position)
            for index, recording in enumerate(recordings)
            if holds_lift_trial(recording)
        }

    def planes(self) -> list[LiftPlane]:
        """As the robot's own sensors place them."""
        return [
            LiftPlane(index, lift.trial.diagonal, lift.plane.point, lift.plane.normal, lift.tilt.verdict)
            for index, lift in self._lifts.items()
        ]

    def estimate(self, trials: int) -> ComEstimate:
        """The crossing of the brackets' middles, and how far the crossings of their ends are from it."""
        brackets = {diagonal: self._bracket(diagonal, trials) for diagonal in DIAGONALS}
        height = float(composite_parameters(self._robot, self._stance.joint_position).com[2])
        planes = [self._end_planes(diagonal, bracket) for diagonal, bracket in brackets.items()]
        com = find_intersection([between(pair) for pair in planes], height)
        corners = [find_intersection(corner, height) for corner in itertools.product(*planes)]
        half = np.abs(np.array(corners) - com).max(axis=0)
        bounds = {diagonal: (bracket.lower, bracket.upper) for diagonal, bracket in brackets.items()}
        return ComEstimate(trials, np.append(com, height), np.append(half, np.nan), None, bounds)

    def _bracket(self, diagonal: str, trials: int) -> Bracket:
        """After the first trials."""
        lifts = [lift for index, lift in self._lifts.items() if index < trials and lift.trial.diagonal == diagonal]
        return reduce(step, [lift.tried for lift in lifts], self._settings.bracket(self._stance))

    def _end_planes(self, diagonal: str, bracket: Bracket) -> list[SupportPlane]:
        """The planes at both ends; as commanded where an end has not been tried."""
        ends = ((bracket.lower, bracket.at_lower), (bracket.upper, bracket.at_upper))
        return [
            commanded_plane(shifted_feet(self._stance, offset), diagonal)
            if tried is None or tried.plane is None
            else tried.plane
            for offset, tried in ends
        ]


class ClosingIn:
    """Estimates after each trial, made by a thread of its own: the newest first, then those before it.

    Use it as a context manager, or `close` it.
    """

    def __init__(self, robot: RobotModel, stance: Stance, settings: CalibrationSettings) -> None:
        self._robot, self._stance, self._settings = robot, stance, settings
        self._recordings: list[Recording] = []
        self._estimates: dict[int, ComEstimate | None] = {}
        self._planes: tuple[LiftPlane, ...] = ()
        self._since = 0  # how often everything began anew
        self._wake, self._over = threading.Condition(), False
        self._thread = threading.Thread(target=self._work, name="estimates", daemon=True)
        self._thread.start()

    def take(self, recordings: Sequence[Recording], anew: bool = False) -> None:
        """More trials are complete; anew: those before are void."""
        with self._wake:
            if anew:
                self._recordings, self._estimates, self._planes = [], {}, ()
                self._since += 1
            self._recordings = [*self._recordings, *recordings]
            self._wake.notify()

    @property
    def planes(self) -> tuple[LiftPlane, ...]:
        """Of all complete lifts, in order."""
        return self._planes

    @property
    def count(self) -> int:
        """After how many trials there is an estimate."""
        return len(self._estimates)

    @property
    def settled(self) -> bool:
        """Whether there is an estimate after every trial."""
        with self._wake:
            return len(self._estimates) >= len(self._recordings)

    def after(self, trials: int) -> ComEstimate | None:
        """The newest estimate that uses no more than so many trials."""
        with self._wake:
            known = [n for n, estimate in self._estimates.items() if n <= trials and estimate is not None]
            return self._estimates[max(known)] if known else None

    def history(self, trials: int) -> list[ComEstimate]:
        """All estimates up to one, in order."""
        with self._wake:
            found = [estimate for n, estimate in sorted(self._estimates.items()) if n <= trials]
        return [estimate for estimate in found if estimate is not None]

    def close(self) -> None:
        """End the thread, behind the estimate that it makes."""
        with self._wake:
            self._over = True
            self._wake.notify()

    def __enter__(self) -> ClosingIn:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _work(self) -> None:
        reading, read = None, -1
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._over or len(self._estimates) < len(self._recordings))
                if self._over:
                    return
                recordings, since = self._recordings, self._since
                count = _next(len(recordings), self._estimates)
            if count == len(recordings) != read:
                reading, read = self._read(recordings), count
            estimate = _known(lambda reading=reading, count=count: reading.estimate(count)) if reading else None
            with self._wake:
                if since == self._since:
                    self._estimates[count] = estimate

    def _read(self, recordings: Sequence[Recording]) -> _Precise | _Paper | None:
        kind = _Paper if self._settings.method == "paper" else _Precise
        reading = _known(lambda: kind(self._robot, self._stance, self._settings, recordings))
        self._planes = tuple(_known(reading.planes) or ()) if reading is not None else ()
        return reading


def _known(ask: Callable[[], Answer]) -> Answer | None:
    """An answer, or None where the recordings do not give one: the run's result will say why, a picture goes on."""
    try:
        return ask()
    except (EquipoiseError, np.linalg.LinAlgError):
        return None


def _next(count: int, known: dict[int, ComEstimate | None]) -> int:
    """The newest that is not known, then the middle of the widest gap."""
    if count not in known:
        return count
    marks = sorted({0, *known})
    low, high = max(itertools.pairwise(marks), key=lambda pair: pair[1] - pair[0])
    return (low + high + 1) // 2
