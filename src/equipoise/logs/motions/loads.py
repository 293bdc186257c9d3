"""Loads of the feet, by joint torques or foot force sensors, as a test of the contacts found by legs and IMU.

Foot force sensors have any unit and offset, and torques have gains and friction: loads are relative to the mean load of a
foot while the robot walks, a quarter of its weight.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import GRAVITY, FloatArray
from equipoise.logs.finding import LogFinding
from equipoise.logs.motions.track import Track, means
from equipoise.recording.runs import true_runs
from equipoise.recording.trials import Step
from equipoise.robot.kinematics import feet_and_forces
from equipoise.robot.model import LEG_NAMES, RobotModel
from equipoise.robot.statics import PLAUSIBLE_LOAD, torques_of_legs

# Of a foot's mean load. Feet in the air read 0.3 by joint torques in simulated trots, as legs are swung, and at most 0.5 by
# sensors on a real Go1; standing feet at least 0.8. Feet that only seem to be up carry 0.8 to 1.5.
_CARRIES, _IDLE = 0.7, 0.3
_UNLOADED = 0.02  # quantile of a foot's readings that is taken as no load
_DEAD = 0.25  # of what the other feet's sensors read: not plausible
_LOOKED_AT = 1000  # samples of a walk that its mean is of, at most


@dataclass(frozen=True, eq=False)
class FootLoads:
    """Loads of the feet, relative to the mean load of a foot.

    The readings of a log's sensors, from which `by_sensors` computes them, have any unit and any offset.

    Attributes:
        source: name of the sensors.
        time: (n,) times, on the joints' clock [s].
        load: (n, 4) loads of the feet FL FR RL RR, larger for more load; not a number where a sensor is not plausible.
    """

    source: str
    time: FloatArray
    load: FloatArray

    @classmethod
    def by_sensors(cls, track: Track, sensed: FootLoads, steps: Sequence[Step]) -> FootLoads:
        """Return loads by foot force sensors, relative to each one's mean from the first step to the last.

        Args:
            steps: times on two feet and three.
        """
        edges = np.append(track.time - track.step / 2, track.time[-1] + track.step / 2)
        force = means(sensed.time, sensed.load, edges)
        in_steps = np.concatenate(
            [np.arange(*track.indices(step.start, step.end).indices(len(force))) for step in steps]
        )
        force = force - np.quantile(force[in_steps], _UNLOADED, axis=0)  # a robot that rests for long has no foot up
        usual = force[_walking(track, steps)].mean(axis=0)
        usual = np.where(usual > _DEAD * np.median(usual), usual, np.nan)
        return cls(sensed.source, track.time, force / usual)

    @classmethod
    def by_torques(cls, robot: RobotModel, track: Track, steps: Sequence[Step]) -> FootLoads | None:
        """Return loads by joint torques, without those of the legs' weight, in the steps; None if they are not plausible.

        Args:
            track: samples with joint torques.
            steps: times on two feet and three.
        """
        walking, parts = _walking(track, steps), [track.indices(step.start, step.end) for step in steps]
        looked_at = np.unique(np.concatenate([_spread(part, part.stop - part.start) for part in parts]))
        position, torque, some = track.joint_position, track.joint_torque, _spread(walking, _LOOKED_AT)
        assert torque is not None  # as the caller has checked
        usual = vertical_forces(robot, position[some], torque[some]).mean()
        if not PLAUSIBLE_LOAD[0] < 4 * usual / (GRAVITY * robot.mass) < PLAUSIBLE_LOAD[1]:
            return None
        load = vertical_forces(robot, position[looked_at], torque[looked_at]) / usual
        return cls("joint torques", track.time[looked_at], load)

    def contradicts(self, step: Step) -> bool:
        """Return whether a lifted foot carries load on the whole, or a standing one does not."""
        # The median: landing feet hit the floor hard, and a step's ends are left out anyway.
        load, stands = np.median(self._in(step)[1], axis=0), np.isin(LEG_NAMES, step.standing)
        return bool((load[~stands] > _CARRIES).any() or (load[stands] < _IDLE).any())

    def cut(self, step: Step, shortest: float) -> Step | None:
        """Return the longest part of a step in which the lifted foot carries no load; None if it is too short.

        Args:
            shortest: shortest duration that counts [s].
        """
        time, load = self._in(step)
        runs = true_runs(~(load[:, LEG_NAMES.index(step.lifted)] > _CARRIES))
        first, last = max(runs, key=lambda run: run[1] - run[0], default=(0, 1))
        part = replace(step, start=float(time[first]), end=float(time[last - 1]))
        return part if part.end - part.start >= shortest else None

    def _in(self, step: Step) -> tuple[FloatArray, FloatArray]:
        """Return times and loads of a step."""
        inside = (self.time >= step.start) & (self.time <= step.end)
        return self.time[inside], self.load[inside]


class Contacts:
    """Comparison of the steps found by legs and IMU with the loads of the feet, where those are measured.

    Foot force sensors that contradict most steps are not used.

    Args:
        robot: model of the robot.
        foot_forces: readings of its foot force sensors, if it has any.
    """

    def __init__(self, robot: RobotModel, foot_forces: FootLoads | None) -> None:
        self._robot, self._foot_forces = robot, foot_forces
        self._seen, self._contradicted = Counter[str](), Counter[str]()
        self._doubted = 0

    def confirmed(self, track: Track, steps: list[Step], shortest: float) -> list[Step]:
        """Return the steps of a track without those that loads contradict.

        Those on three feet are cut to the time in which the lifted foot carries no load: on uneven floors a foot may only
        seem to be up. Those on two are not: it would add no information.

        Args:
            steps: steps on two feet and three.
            shortest: shortest duration of a step on three feet [s].
        """
        if track.joint_torque is not None and steps:
            by_torques = FootLoads.by_torques(self._robot, track, steps)
            if by_torques is not None:
                steps = self._less(by_torques, steps, shortest)
        if self._foot_forces is not None and steps:
            by_sensors = FootLoads.by_sensors(track, self._foot_forces, steps)
            if 2 * sum(map(by_sensors.contradicts, steps)) > len(steps):
                self._doubted += len(steps)
            else:
                steps = self._less(by_sensors, steps, shortest)
        return steps

    def _less(self, loads: FootLoads, steps: Sequence[Step], shortest: float) -> list[Step]:
        cut = [step if len(step.standing) == 2 else loads.cut(step, shortest) for step in steps]
        kept = [step for step in cut if step is not None and not loads.contradicts(step)]
        self._seen[loads.source] += len(steps)
        self._contradicted[loads.source] += len(steps) - len(kept)
        return kept

    def findings(self) -> list[LogFinding]:
        """Return findings on the contradictions."""
        found: list[LogFinding] = []
        for source, count in (+self._contradicted).items():  # positive counts
            message = (
                f"{source} contradict {count} of {self._seen[source]} steps found by legs and IMU: a lifted foot carries "
                "load, or a standing one does not. These steps are left out"
            )
            found.append(LogFinding("contacts", message))
        if self._doubted:
            message = (
                f"foot forces contradict most of {self._doubted} steps found by legs and IMU, and are not used: check that "
                "each belongs to its leg and grows with the load"
            )
            found.append(LogFinding("contacts", message))
        return found


def _walking(track: Track, steps: Sequence[Step]) -> slice:
    """Return the part of a track from the first step to the last."""
    return track.indices(min(step.start for step in steps), max(step.end for step in steps))


def _spread(part: slice, count: int) -> NDArray[np.intp]:
    """Return the indices of some samples of a part of a track, evenly spaced."""
    return np.unique(np.linspace(part.start, part.stop - 1, count, dtype=np.intp))


def vertical_forces(robot: RobotModel, position: FloatArray, torque: FloatArray) -> FloatArray:
    """Return (n, 4) forces on the feet along the base's z axis, by (n, nj) positions and torques of the joints [N]."""
    of_legs = np.array([torques_of_legs(robot, one) for one in position])
    return feet_and_forces(robot, position, torque - of_legs)[1][:, :, 2]
