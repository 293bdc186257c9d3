"""How the CoM estimate closes in: what was known after each trial, by the method's own arithmetic.

precise: the posterior of all trials so far, in three dimensions. paper: the two brackets, and where their middles cross.
"""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from equipoise.calibration.settings import CalibrationSettings
from equipoise.conventions import FloatArray
from equipoise.errors import EquipoiseError
from equipoise.experiments.tilt import SupportPlane, support_plane_of, tilt_of
from equipoise.paper.equations import between, commanded_plane, find_intersection
from equipoise.paper.trial_runner import lift_heights, shifted_feet
from equipoise.precise.measurements.evidence import Evidence, read_evidence
from equipoise.precise.measurements.support_planes import centre_shift
from equipoise.precise.posterior import estimate_posterior
from equipoise.recording.recording import Recording
from equipoise.result.statistics import NORMAL_95
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.model import DIAGONALS, RobotModel
from equipoise.robot.stance import Stance

Bracket = tuple[float, float]
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
    brackets: dict[str, Bracket]


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
        shifts = [(motion, centre_shift(self._robot, motion.lift)) for motion in self._motions if motion.lift]
        return [
            LiftPlane(motion.index, str(motion.about["diagonal"]), com + shift.distance * shift.normal, shift.normal)
            for motion, shift in shifts
        ]

    def estimate(self, trials: int) -> ComEstimate:
        """The posterior of the first trials."""
        motions, settings = self._motions[:trials], self._settings
        posterior = estimate_posterior(
            self._robot, self._stance, Evidence(motions), settings.priors, settings.scale,
            lifts_needed=any(motion.lift for motion in motions),
        )  # fmt: skip
        covariance = posterior.robot_covariance[1:4, 1:4]
        return ComEstimate(trials, posterior.robot_body.com, NORMAL_95 * np.sqrt(np.diag(covariance)), covariance, {})


@dataclass(frozen=True, eq=False)
class _Lift:
    """A complete lift of a bisection."""

    index: int
    recording: Recording
    plane: SupportPlane
    verdict: str

    @property
    def diagonal(self) -> str:
        return str(self.recording.trial["diagonal"])


class _Paper:
    """The paper's reading of trials: which side of the support line the CoM is on."""

    def __init__(
        self, robot: RobotModel, stance: Stance, settings: CalibrationSettings, recordings: Sequence[Recording]
    ) -> None:
        self._robot, self._stance, self._settings = robot, stance, settings.com_search
        self._lifts = [
            _Lift(index, recording, *self._read(recording))
            for index, recording in enumerate(recordings)
            if recording.trial.get("kind") == "lift" and recording.has_phase("lower")
        ]

    def planes(self) -> list[LiftPlane]:
        """As the robot's own sensors place them."""
        return [
            LiftPlane(lift.index, lift.diagonal, lift.plane.point, lift.plane.normal, lift.verdict)
            for lift in self._lifts
        ]

    def estimate(self, trials: int) -> ComEstimate:
        """The crossing of the brackets' middles, and how far the crossings of their ends are from it."""
        ends = self._brackets([lift for lift in self._lifts if lift.index < trials])
        height = float(composite_parameters(self._robot, self._stance.joint_position).com[2])
        planes = [[plane for _, plane in of_diagonal.values()] for of_diagonal in ends.values()]
        com = find_intersection([between(pair) for pair in planes], height)
        corners = [find_intersection(corner, height) for corner in itertools.product(*planes)]
        half = np.abs(np.array(corners) - com).max(axis=0)
        brackets = {name: (pair["forward"][0], pair["backward"][0]) for name, pair in ends.items()}
        return ComEstimate(trials, np.append(com, height), np.append(half, np.nan), None, brackets)

    def _read(self, recording: Recording) -> tuple[SupportPlane, str]:
        about, robot = recording.trial, self._robot
        plane = support_plane_of(robot, recording, str(about["diagonal"]), self._stance.joint_position)
        return plane, tilt_of(robot, recording, str(about["diagonal"]), float(about["tilt_threshold"])).verdict

    def _brackets(self, lifts: Sequence[_Lift]) -> dict[str, dict[str, tuple[float, SupportPlane]]]:
        """Offset and plane of the last lift to tip either way, by diagonal; before there is one, where the search begins."""
        feet, bounds = self._stance, self._settings.bounds(self._stance)
        ends = {
            diagonal: {
                verdict: (offset, commanded_plane(shifted_feet(feet, offset), diagonal))
                for verdict, offset in zip(("forward", "backward"), bounds, strict=True)
            }
            for diagonal in DIAGONALS
        }
        highest = lift_heights(self._settings.lift(self._stance))[-1]
        for lift in lifts:
            end = float(lift.recording.trial["offset"]), lift.plane
            if lift.verdict != "balanced":
                ends[lift.diagonal][lift.verdict] = end
            elif float(lift.recording.trial["lift_height"]) > 0.999 * highest:  # else it is tried again, higher
                ends[lift.diagonal] = dict.fromkeys(ends[lift.diagonal], end)
        return ends


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
