"""Loads of the feet, by joint torques or by the feet's own sensors: a test of the feet that legs and IMU see standing.

What sensors of feet say has any unit and any offset, and torques have gains and friction: loads are held against what the
feet carry on average while the robot walks, a quarter of its weight each.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.logs.finding import LogFinding
from equipoise.logs.motions.track import Integral, Track
from equipoise.recording.runs import true_runs
from equipoise.recording.trials import ThreeFeet, TwoFeet
from equipoise.robot.kinematics import feet_and_forces
from equipoise.robot.model import LEG_NAMES, RobotModel
from equipoise.robot.statics import PLAUSIBLE_LOAD, torques_of_legs

# Of what a foot carries on average. Feet that are up in simulated trots carry 0.3 by joint torques, as legs are swung, and in
# a real Go1's 0.5 at most by sensors; those that stand 0.8 at least. Feet that only seem to be up carry 0.8 to 1.5.
_CARRIES, _IDLE = 0.7, 0.3
_UNLOADED = 0.02  # of the time a foot's sensor reads less than this: it is up then
_DEAD = 0.25  # of what the other feet's sensors read: not to be believed
_LOOKED_AT = 1000  # samples of a walk that its mean is of, at most

Step = TwoFeet | ThreeFeet


@dataclass(frozen=True, eq=False)
class FootForces:
    """Readings of the sensors of the feet.

    Attributes:
        time: (n,) times, on the joints' clock [s].
        force: (n, 4) readings of the feet FL FR RL RR, in any unit and with any offset; more is more load.
    """

    time: FloatArray
    force: FloatArray


@dataclass(frozen=True, eq=False)
class FootLoads:
    """Loads of the feet, over what a foot carries on average.

    Attributes:
        source: what they are from, in words.
        time: (n,) times [s].
        load: (n, 4) loads of the feet FL FR RL RR; not a number where a sensor is not plausible.
    """

    source: str
    time: FloatArray
    load: FloatArray

    @classmethod
    def by_sensors(cls, track: Track, sensed: FootForces, steps: Sequence[Step]) -> FootLoads:
        """Return loads by sensors of the feet, over each one's own mean from the first step to the last.

        Args:
            steps: times on two feet and three.
        """
        edges = np.append(track.time - track.step / 2, track.time[-1] + track.step / 2)
        force = Integral(sensed.time, sensed.force).means(edges)
        in_steps = np.concatenate(
            [np.arange(*track.indices(step.start, step.end).indices(len(force))) for step in steps]
        )
        force = force - np.quantile(force[in_steps], _UNLOADED, axis=0)  # a robot that rests for long has no foot up
        usual = force[_walking(track, steps)].mean(axis=0)
        usual = np.where(usual > _DEAD * np.median(usual), usual, np.nan)
        return cls("foot forces", track.time, force / usual)

    @classmethod
    def by_torques(cls, robot: RobotModel, track: Track, steps: Sequence[Step]) -> FootLoads | None:
        """Return loads by joint torques less those that carry the legs, in the steps; None if they do not carry such a robot.

        Args:
            track: samples with joint torques.
            steps: times on two feet and three.
        """
        walking, parts = _walking(track, steps), [track.indices(step.start, step.end) for step in steps]
        looked_at = np.unique(np.concatenate([_spread(part, part.stop - part.start) for part in parts]))
        usual = _vertical_forces(robot, track, _spread(walking, _LOOKED_AT)).mean()
        if not PLAUSIBLE_LOAD[0] < 4 * usual / (GRAVITY * robot.mass) < PLAUSIBLE_LOAD[1]:
            return None
        return cls("joint torques", track.time[looked_at], _vertical_forces(robot, track, looked_at) / usual)

    def contradicts(self, step: Step) -> bool:
        """Return whether a foot that is up carries all in all, or one that stands does not."""
        # The median: feet that land do it hard, and what is near a step's ends is left out of it anyway.
        load, stands = np.median(self._in(step)[1], axis=0), np.isin(LEG_NAMES, step.standing)
        return bool((load[~stands] > _CARRIES).any() or (load[stands] < _IDLE).any())

    def cut(self, step: ThreeFeet, shortest: float) -> ThreeFeet | None:
        """The longest part of a step in which the foot that is up carries nothing; None if that is shorter than that.

        Args:
            shortest: shortest duration that counts [s].
        """
        time, load = self._in(step)
        runs = true_runs(~(load[:, LEG_NAMES.index(step.lifted)] > _CARRIES))
        first, last = max(runs, key=lambda run: run[1] - run[0], default=(0, 1))
        part = replace(step, start=float(time[first]), end=float(time[last - 1]))
        return part if part.end - part.start >= shortest else None

    def _in(self, step: Step) -> tuple[FloatArray, FloatArray]:
        """Times and loads of a step."""
        inside = (self.time >= step.start) & (self.time <= step.end)
        return self.time[inside], self.load[inside]


class Contacts:
    """Steps that legs and IMU see, held against what the feet carry, where anything says that.

    Sensors of feet that contradict most steps are themselves in doubt, and not used.

    Args:
        robot: model of the robot.
        foot_forces: what the sensors of its feet say, if it has any.
    """

    def __init__(self, robot: RobotModel, foot_forces: FootForces | None) -> None:
        self._robot, self._foot_forces = robot, foot_forces
        self._seen, self._contradicted = Counter[str](), Counter[str]()
        self._doubted = 0

    def confirmed(
        self, track: Track, on_two: Sequence[TwoFeet], on_three: Sequence[ThreeFeet], shortest: float
    ) -> tuple[list[TwoFeet], list[ThreeFeet]]:
        """Steps of a track less those that loads contradict.

        Those on three feet are cut to when the foot that is up carries nothing: on uneven floors one may seem to be up.
        Those on two are not: it makes them tell no more.

        Args:
            on_two, on_three: steps, in order.
            shortest: shortest duration of a step on three feet [s].
        """
        two, three = list(on_two), list(on_three)
        if track.joint_torque is not None and (two or three):
            by_torques = FootLoads.by_torques(self._robot, track, [*two, *three])
            if by_torques is not None:
                two, three = self._less(by_torques, two, three, shortest)
        if self._foot_forces is not None and (two or three):
            by_sensors = FootLoads.by_sensors(track, self._foot_forces, [*two, *three])
            if 2 * sum(map(by_sensors.contradicts, [*two, *three])) > len(two) + len(three):
                self._doubted += len(two) + len(three)
            else:
                two, three = self._less(by_sensors, two, three, shortest)
        return two, three

    def _less(
        self, loads: FootLoads, two: list[TwoFeet], three: list[ThreeFeet], shortest: float
    ) -> tuple[list[TwoFeet], list[ThreeFeet]]:
        cut = [part for step in three if (part := loads.cut(step, shortest)) is not None]
        kept = (
            [step for step in two if not loads.contradicts(step)],
            [step for step in cut if not loads.contradicts(step)],
        )
        self._seen[loads.source] += len(two) + len(three)
        self._contradicted[loads.source] += len(two) + len(three) - len(kept[0]) - len(kept[1])
        return kept

    def findings(self) -> list[LogFinding]:
        """Contradictions, in words."""
        found = [
            LogFinding(
                "contacts",
                f"by {source} {count} of {self._seen[source]} steps that legs and IMU see are none: feet that seem to be up "
                "carry the robot, or such that seem to stand do not. They are left out",
            )
            for source, count in self._contradicted.items()
            if count
        ]
        if self._doubted:
            message = (
                f"foot forces contradict most of {self._doubted} steps that legs and IMU see, and are not used: is each that "
                "of its leg, and does it grow with the load?"
            )
            found.append(LogFinding("contacts", message))
        return found


def _walking(track: Track, steps: Sequence[Step]) -> slice:
    """Return the part of a track from the first step to the last."""
    return track.indices(min(step.start for step in steps), max(step.end for step in steps))


def _spread(part: slice, count: int) -> NDArray[np.intp]:
    """Indices of some samples of a part of a track, evenly spread."""
    return np.unique(np.linspace(part.start, part.stop - 1, count, dtype=np.intp))


def _vertical_forces(robot: RobotModel, track: Track, samples: NDArray[np.intp]) -> FloatArray:
    """(k, 4) forces on the feet along the base's up, by the joint torques of k samples, by index [N]."""
    assert track.joint_torque is not None
    position = track.joint_position[samples]
    of_legs = np.array([torques_of_legs(robot, one) for one in position])
    return feet_and_forces(robot, position, track.joint_torque[samples] - of_legs)[1][:, :, 2]
