"""What is shown at a moment: pure arithmetic on a film and on what was known of the CoM by then."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from equipoise.conventions import FloatArray
from equipoise.method.reading import ComEstimate, LiftPlane
from equipoise.recording.phases import Phase
from equipoise.result.statistics import ellipsoid_95
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.kinematics import Kinematics
from equipoise.robot.model import DIAGONALS, LEG_NAMES
from equipoise.robot.stance import Stance
from equipoise.view.closing_in import ClosingIn
from equipoise.view.film import Film, TrialMark

_STANDS = 0.1  # of what a foot counts as on the floor: slopes and leaning IMUs raise some by millimetres
_LINE_LENGTH = 0.16  # [m] on an A1, to either side


@dataclass(frozen=True, eq=False)
class Frame:
    """A moment.

    Attributes:
        time: moment of it [s].
        joint_position, joint_torque: (nj,) values then [rad], [Nm].
        rotation_base_to_world: (3, 3) of the base.
        position_in_world: (3,) the base's origin [m].
        contacts_in_world: (4, 3) lowest points of the feet [m].
        standing: (4,) whether each foot stands.
        com_in_world: (3,) CoM of the whole robot, by the newest estimate or else by the model [m].
        support_line_in_world: (2, 3) right and left contact point during a lift trial [m]; or None.
        tilt: turn of the base about that line since the rest before, positive forward [rad]; or None.
        trial: trial that is running or was last.
        phase: phase of that trial.
        complete: number of trials that are complete.
        estimate: estimate of the CoM from those; or None.
        planes: support planes of those.
    """

    time: float
    joint_position: FloatArray
    joint_torque: FloatArray
    rotation_base_to_world: FloatArray
    position_in_world: FloatArray
    contacts_in_world: FloatArray
    standing: NDArray[np.bool_]
    com_in_world: FloatArray
    support_line_in_world: FloatArray | None
    tilt: float | None
    trial: TrialMark | None
    phase: str | None
    complete: int
    estimate: ComEstimate | None
    planes: tuple[LiftPlane, ...]


class Camera:
    """Takes frames of a film.

    Args:
        film: what was recorded.
        closing_in: what was known when.
    """

    def __init__(self, film: Film, closing_in: ClosingIn) -> None:
        self.film, self.closing_in = film, closing_in
        self._nominal_com = composite_parameters(film.robot, film.stance.joint_position).com
        self._radius = np.array([leg.foot_radius for leg in film.robot.legs.values()])

    def frame(self, time: float) -> Frame:
        """The moment nearest before a time [s], of a film that is not empty."""
        film, moments = self.film, self.film.moments
        index = self._index(time)
        now = float(moments.time[index])
        contacts = moments.feet_in_world[index] - self._radius[:, None] * [0, 0, 1]
        trial, phase, complete = film.trial_at(now), film.phase_at(now), film.complete_at(now)
        estimate = self.closing_in.after(complete)
        line = _support_line(trial, contacts)
        tilt = None if trial is None or line is None else self.tilts(trial, now)
        return Frame(
            now,
            moments.joint_position[index],
            moments.joint_torque[index],
            moments.rotation_base_to_world[index],
            moments.position_in_world[index],
            contacts,
            moments.standing[index] > _STANDS,
            self._com(index, estimate),
            line,
            None if tilt is None or not len(tilt[1]) else float(tilt[1][-1]),
            trial,
            phase,
            complete,
            estimate,
            tuple(plane for plane in self.closing_in.planes if plane.trial < complete) if estimate else (),
        )

    def tilts(self, trial: TrialMark, until: float) -> tuple[FloatArray, FloatArray] | None:
        """Times since the lift began [s] and tilts about the support line [rad], up to a time; None before it begins.

        The base's rotation since the rest, about the line's direction: what ends a lift when it is plain.
        """
        start = self.film.phase_start(Phase.UNLOAD, trial, until)
        if trial.diagonal is None or start is None:
            return None
        moments = self.film.moments
        first, last = self._index(start), self._index(until) + 1
        contacts = moments.feet_in_world[first] - self._radius[:, None] * [0, 0, 1]
        line = _support_line(trial, contacts)
        if line is None or last <= first:
            return None
        turned = Rotation.from_matrix(
            moments.rotation_base_to_world[first:last] @ moments.rotation_base_to_world[first].T
        ).as_rotvec()
        direction = (line[1] - line[0]) / np.linalg.norm(line[1] - line[0])
        return moments.time[first:last] - start, turned @ direction

    def _index(self, time: float) -> int:
        times = self.film.moments.time
        return int(np.clip(np.searchsorted(times, time + 1e-9, side="right") - 1, 0, len(times) - 1))

    def _com(self, index: int, estimate: ComEstimate | None) -> FloatArray:
        """In the world: the model's at this posture, moved by what was found at the nominal stance."""
        moments, robot = self.film.moments, self.film.robot
        in_base = Kinematics(robot).com(moments.joint_position[index])
        if estimate is not None:
            in_base = in_base + estimate.com - self._nominal_com
        return moments.position_in_world[index] + moments.rotation_base_to_world[index] @ in_base


def joint_poses(film: Film, joint_position: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Rotation and place of the joints' frames in the base frame, from the base's own (1) on [m]."""
    poses = Kinematics(film.robot).joint_poses(joint_position)
    return [(np.array(pose.rotation), np.array(pose.translation)) for pose in poses[1:]]


def ellipsoid(estimate: ComEstimate | None) -> tuple[FloatArray, FloatArray] | None:
    """(3, 3) axes in the base frame and (3,) half lengths [m] of where the CoM is with 95 %; None if that is unknown."""
    if estimate is None or estimate.covariance is None:
        return None
    return ellipsoid_95(estimate.covariance)


def plane_lines(frame: Frame, stance: Stance) -> FloatArray:
    """(n, 2, 3) a piece of each lift's plane nearest to the newest CoM, level, in base axes from there [m]."""
    if frame.estimate is None:
        return np.empty((0, 2, 3))
    lines: list[FloatArray] = []
    for lift in frame.planes:
        plane = lift.plane
        along = np.cross(plane.normal, [0, 0, 1.0])
        along *= _LINE_LENGTH * stance.scale.length / float(np.linalg.norm(along))
        across = plane.normal * [1, 1, 0]
        near = across * float(plane.normal @ (plane.point - frame.estimate.com)) / float(across @ across)
        lines.append(np.array([near - along, near + along]))
    return np.array(lines).reshape(-1, 2, 3)


def _support_line(trial: TrialMark | None, contacts: FloatArray) -> FloatArray | None:
    if trial is None or trial.diagonal is None:
        return None
    left, right = sorted(DIAGONALS[trial.diagonal], key=lambda leg: leg[1])
    return contacts[[LEG_NAMES.index(right), LEG_NAMES.index(left)]]
