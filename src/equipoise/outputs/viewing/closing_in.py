"""How the CoM estimate closes in: what was known after each trial, by the method's own arithmetic.

precise: the posterior of all trials so far, in three dimensions. paper: the two brackets, and where their middles cross.
"""

from __future__ import annotations

import itertools
import threading
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from equipoise.errors import EquipoiseError
from equipoise.estimation.evidence import Motion, read_evidence
from equipoise.estimation.paper import between, commanded_plane, find_intersection
from equipoise.estimation.posterior import estimate_posterior
from equipoise.estimation.support_planes import centre_shift
from equipoise.estimation.tilt import SupportPlane, support_plane_of, tilt_of
from equipoise.experiments.trial_runner import lift_heights, shifted_feet
from equipoise.methods.settings import CalibrationSettings
from equipoise.recordings.recording import Recording
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.model import DIAGONALS, RobotModel
from equipoise.robot.stance import Stance

FloatArray = NDArray[np.float64]
Bracket = tuple[float, float]

NORMAL_95 = 1.96


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
    brackets: dict[str, Bracket]


def estimate_after(
    robot: RobotModel, stance: Stance, settings: CalibrationSettings, recordings: Sequence[Recording], rounds: int = 2
) -> ComEstimate | None:
    """What these recordings say; None if that is nothing yet.

    Args:
        rounds: precise: how often noise levels are renewed; a result has two.
    """
    try:
        if settings.method == "paper":
            return _by_brackets(robot, stance, settings, recordings)
        return _by_posterior(robot, stance, settings, recordings, rounds)
    except (EquipoiseError, np.linalg.LinAlgError):  # the result will say what is wrong; a picture goes on
        return None


def lift_planes(
    robot: RobotModel, stance: Stance, settings: CalibrationSettings, recordings: Sequence[Recording], first: int = 0
) -> list[LiftPlane]:
    """Planes of the lifts among recordings, which are the trials from a first one on."""
    if settings.method == "paper":
        return [
            LiftPlane(first + index, diagonal, plane.point, plane.normal, verdict)
            for index, diagonal, _, plane, verdict in _tried(robot, stance, recordings)
        ]
    com = composite_parameters(robot, stance.joint_position).com
    planes: list[LiftPlane] = []
    try:
        motions = read_evidence(robot, stance, recordings).motions
    except EquipoiseError:
        return []
    for motion in motions:
        if motion.lift is not None:
            shift = centre_shift(robot, motion.lift)
            point = com + shift.distance * shift.normal
            planes.append(LiftPlane(first + motion.index, motion.lift.diagonal, point, shift.normal))
    return planes


def _by_posterior(
    robot: RobotModel, stance: Stance, settings: CalibrationSettings, recordings: Sequence[Recording], rounds: int
) -> ComEstimate:
    precise = settings.precise
    evidence = read_evidence(robot, stance, recordings)
    lifts = any(_has_lift(motion) for motion in evidence.motions)
    posterior = estimate_posterior(robot, stance, evidence, precise.priors, precise.scale, rounds, lifts_needed=lifts)
    covariance = posterior.robot_covariance[1:4, 1:4]
    half = NORMAL_95 * np.sqrt(np.diag(covariance))
    return ComEstimate(len(recordings), posterior.robot_body.com, half, covariance, {})


def _has_lift(motion: Motion) -> bool:
    return motion.lift is not None


def _tried(
    robot: RobotModel, stance: Stance, recordings: Sequence[Recording]
) -> list[tuple[int, str, Recording, SupportPlane, str]]:
    """Index, diagonal, recording, plane and verdict of every complete lift of a bisection."""
    found: list[tuple[int, str, Recording, SupportPlane, str]] = []
    for index, recording in enumerate(recordings):
        about = recording.trial
        if about.get("kind") == "lift" and recording.has_phase("lower"):
            diagonal = str(about["diagonal"])
            verdict = tilt_of(robot, recording, diagonal, float(about["tilt_threshold"])).verdict
            plane = support_plane_of(robot, recording, diagonal, stance.joint_position)
            found.append((index, diagonal, recording, plane, verdict))
    return found


def _by_brackets(
    robot: RobotModel, stance: Stance, settings: CalibrationSettings, recordings: Sequence[Recording]
) -> ComEstimate:
    """The crossing of the brackets' middles, and how far the crossings of their ends are from it."""
    searching = settings.com_search
    highest = lift_heights(searching.lift(stance))[-1]
    lower, upper = searching.bounds(stance)
    ends = {
        diagonal: {
            verdict: (offset, commanded_plane(shifted_feet(stance, offset), diagonal))
            for verdict, offset in (("forward", lower), ("backward", upper))
        }
        for diagonal in DIAGONALS
    }
    for _, diagonal, recording, plane, verdict in _tried(robot, stance, recordings):
        end = float(recording.trial["offset"]), plane
        if verdict != "balanced":
            ends[diagonal][verdict] = end
        elif float(recording.trial["lift_height"]) > 0.999 * highest:
            ends[diagonal] = dict.fromkeys(ends[diagonal], end)
    height = float(composite_parameters(robot, stance.joint_position).com[2])
    planes = [[plane for _, plane in of_diagonal.values()] for of_diagonal in ends.values()]
    com = find_intersection([between(pair) for pair in planes], height)
    corners = [find_intersection(corner, height) for corner in itertools.product(*planes)]
    half = np.abs(np.array(corners) - com).max(axis=0)
    brackets = {name: (pair["forward"][0], pair["backward"][0]) for name, pair in ends.items()}
    return ComEstimate(len(recordings), np.append(com, height), np.append(half, np.nan), None, brackets)


class ClosingIn:
    """Estimates after each trial, made by a thread of its own: the newest first, then those before it.

    Use it as a context manager, or `close` it.
    """

    def __init__(self, robot: RobotModel, stance: Stance, settings: CalibrationSettings) -> None:
        self._robot, self._stance, self._settings = robot, stance, settings
        self._recordings: list[Recording] = []
        self._estimates: dict[int, ComEstimate | None] = {}
        self._planes: list[LiftPlane] = []
        self._since = 0  # how often everything began anew
        self._wake, self._over = threading.Condition(), False
        self._thread = threading.Thread(target=self._work, name="estimates", daemon=True)
        self._thread.start()

    def take(self, recordings: Sequence[Recording], anew: bool = False) -> None:
        """More trials are complete; anew: those before are void."""
        with self._wake:
            if anew:
                self._recordings, self._estimates, self._planes = [], {}, []
                self._since += 1
            first = len(self._recordings)
            self._recordings += recordings
            self._planes += lift_planes(self._robot, self._stance, self._settings, recordings, first)
            self._wake.notify()

    @property
    def planes(self) -> tuple[LiftPlane, ...]:
        """Of all complete lifts, in order."""
        return tuple(self._planes)

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
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._over or len(self._estimates) < len(self._recordings))
                if self._over:
                    return
                recordings, since = self._recordings[:], self._since
                count = _next(len(recordings), self._estimates)
            rounds = 2 if count == len(recordings) else 1  # what is shown of the past needs no result's care
            estimate = estimate_after(self._robot, self._stance, self._settings, recordings[:count], rounds)
            with self._wake:
                if since == self._since:
                    self._estimates[count] = estimate


def _next(count: int, known: dict[int, ComEstimate | None]) -> int:
    """The newest that is not known, then the middle of the widest gap."""
    if count not in known:
        return count
    marks = sorted({0, *known})
    low, high = max(itertools.pairwise(marks), key=lambda pair: pair[1] - pair[0])
    return (low + high + 1) // 2
