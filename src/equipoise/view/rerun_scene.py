"""Contents of a Rerun recording: robot, feet, support line and CoM, plots of sensors, and texts, on one timeline."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.figures.geometry import Part, drawn_shapes
from equipoise.method.reading import ComEstimate, LiftPlane
from equipoise.recording.event import PHASE, TRIAL, Event
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.recording.trials import CommandedLift, DesignedLift, LiftTrial, RecordedTrial, read_trial
from equipoise.result.statistics import ellipsoid_95
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.kinematics import Kinematics
from equipoise.robot.model import DIAGONALS, LEG_NAMES, RobotModel
from equipoise.robot.stance import Stance
from equipoise.view.base_motion import BaseMotion, BaseTracker

TIMELINE = "time"
_EVERY = 4  # every fourth step is shown: 25 a second
# Weight above which a foot is shown as standing, since slopes raise some feet; largest enlargement of the CoM's ellipsoid.
_STANDS, _MAGNIFIED = 0.1, 10.0
_FOOT, _LINE, _CENTRE, _PLANE, _ELLIPSOID = 0.012, 0.004, 0.012, 0.16, 0.15  # [m] sizes for an A1
_STANDING, _IN_AIR, _ORANGE, _RED = (46, 160, 90), (170, 176, 186), (240, 140, 20), (214, 51, 108)
_COLOURS: dict[Part, tuple[int, int, int]] = {
    "base": (70, 86, 112), "hip": (92, 108, 134), "thigh": (148, 162, 184), "shank": (192, 202, 216),
}  # fmt: skip
_TIPPED: dict[str | None, tuple[int, int, int]] = {
    "forward": (47, 126, 216), "backward": (232, 116, 59), "balanced": (58, 166, 85), None: (122, 135, 148),
}  # fmt: skip
_PLOTS = {
    "tilt": "Tilt about the support line [deg], positive forward",
    "com_half_width": "Uncertainty of the CoM, half width [mm]",
    "torque": "Joint torques [Nm]",
    "gyroscope": "Gyroscope [deg/s]",
    "accelerometer": "Accelerometer [m/s2]",
}
_KINDS = {
    "lift": "The robot unloads and lifts two diagonal feet and stands on the other two. Their contact points span the "
    "**support line** (orange). The robot tips towards the side of the line on which its CoM is, until the feet are lowered.",
    "posture": "The body moves over four standing feet. The joint torques at rest determine mass and CoM.",
    "excitation": "The body oscillates over four standing feet. Its accelerations determine the inertia.",
    "motors": "The legs swing. Their torques determine friction, armature and delay of the motors.",
}
_LEGEND = """\
- **green, grey**: foot on the floor, foot in the air
- **orange line**: support line of the lift trial
- **red**: centre of mass (CoM) and its plumb line; until the first estimate from the model file
- **red ellipsoid**: contains the CoM with 95 % probability; enlarged up to 10 times
- **lines through the CoM**: support planes of all lift trials, the newest also as a plane. With method `paper` blue if the \
robot tipped forward, orange if backward, green if balanced
"""


def blueprint() -> Any:
    """Return the layout of the viewer, which plays from the beginning and waits at the end for more data."""
    b: Any = import_module("rerun.blueprint")
    plots = [
        b.TimeSeriesView(origin=entity, name=name, plot_legend=b.PlotLegend(visible=entity != "torque"))
        for entity, name in _PLOTS.items()
    ]
    titles = {"now": "Now", "com": "Centre of mass (CoM)", "legend": "Legend"}
    texts = [b.TextDocumentView(origin=entity, name=title) for entity, title in titles.items()]
    eye = b.EyeControls3D(position=(0.8, -1.1, 0.7), look_target=(0.0, 0.0, 0.15), eye_up=(0, 0, 1))
    columns = b.TextLogColumns(text_log_columns=["Body"])
    trials = b.TextLogView(origin="trials", name="Trials (click a time to jump to it)", columns=columns)
    robot = b.Vertical(b.Spatial3DView(origin="world", name="Robot", eye_controls=eye), trials, row_shares=[4, 1])
    words, curves = b.Vertical(*texts, row_shares=[3, 3, 4]), b.Vertical(*plots[:2], b.Tabs(*plots[2:]))
    layout = b.Horizontal(words, robot, curves, column_shares=[6, 15, 10])
    panels = [panel(state="hidden") for panel in (b.BlueprintPanel, b.SelectionPanel)]
    return b.Blueprint(layout, *panels, b.TimePanel(state="collapsed", timeline=TIMELINE, play_state="playing"))


class Scene:
    """Writer of a robot's motion and of the estimates into a Rerun recording.

    Args:
        stream: Rerun recording to write to.
        expected: approximate number of trials, or None.

    Attributes:
        steps: number of steps so far.
    """

    def __init__(self, stream: Any, robot: RobotModel, stance: Stance, expected: int | None) -> None:
        self._rr: Any = import_module("rerun")
        self._stream, self._robot, self._expected, self._size = stream, robot, expected, stance.scale.length
        self._tracker, self._kinematics = BaseTracker(robot, stance), Kinematics(robot)
        self._nominal_com = composite_parameters(robot, stance.joint_position).com
        self._radii = np.array([leg.foot_radius for leg in robot.legs.values()])
        self._links = ["base", *(str(name).replace("/", "_") for name in list(robot.pinocchio.names)[2:])]
        self._start = np.nan  # time of the first sample
        self.steps, self._trials = 0, 0
        self._events: list[Event] = []  # not shown yet
        self._ends: list[float] = []  # of the complete trials
        self._trial: RecordedTrial | None = None
        self._lift: tuple[FloatArray, FloatArray] | None = None  # attitude and direction of the line at unloading
        self._log_static()

    def take(self, pieces: Sequence[Recording], complete: Sequence[Recording]) -> None:
        """Write new data.

        Args:
            pieces: new pieces of motion, in order.
            complete: newly complete trials.
        """
        with suppress(RecordingError):  # no pieces, or the clock was reset in between
            pieces = [Recording.concatenate(pieces)]  # Rerun reads few large chunks faster
        for piece in pieces:
            if np.isnan(self._start):
                self._start = float(next(stream.time[0] for stream in (piece.joints, piece.imu) if stream.time.size))
            self._events += piece.events
            motion = self._tracker.take(piece)
            if motion is not None:
                chosen = slice(-self.steps % _EVERY, None, _EVERY)
                self.steps += len(motion.standing)
                if motion.standing[chosen].size:
                    self._log_motion(motion, chosen)
        self._ends += [float(recording.joints.time[-1]) for recording in complete]

    def log_estimate(self, found: tuple[ComEstimate, Sequence[LiftPlane]] | None) -> None:
        """Write an estimate and its support planes at the end of its last trial; do nothing for None."""
        if found is None:
            return
        estimate, planes = found
        rr, place = self._rr, "world/robot/com/estimate"
        self._set_time(self._ends[estimate.trials - 1])
        self._log_text("com", estimate_text(estimate))
        self._stream.log("com_half_width", rr.Scalars(1000 * estimate.half_width))
        self._stream.log(place, rr.Transform3D(translation=estimate.com - self._nominal_com))
        if estimate.covariance is not None:
            axes, semi_axes = ellipsoid_95(estimate.covariance)
            shown = semi_axes * min(_MAGNIFIED, _ELLIPSOID * self._size / semi_axes.max())
            turned, colours = Rotation.from_matrix(axes).as_quat(), [(*_RED, 90)]
            ellipsoid = rr.Ellipsoids3D(half_sizes=[shown], quaternions=[turned], colors=colours, fill_mode="solid")
            self._stream.log(f"{place}/ellipsoid", ellipsoid)
        if planes:
            pieces = np.array([plane_piece(plane, estimate.com, _PLANE * self._size) for plane in planes])
            colours = [_TIPPED[plane.verdict] for plane in planes]
            lines = rr.LineStrips3D(pieces[:, :2], radii=rr.Radius.ui_points(1.0), colors=colours)
            self._stream.log(f"{place}/lines", lines)
            faces, colour = [[0, 1, 2], [0, 2, 3]], (*colours[-1], 60)
            newest = rr.Mesh3D(vertex_positions=pieces[-1], triangle_indices=faces, albedo_factor=colour)
            self._stream.log(f"{place}/newest_plane", newest)

    def _log_static(self) -> None:
        rr, size = self._rr, self._size
        for number, shape in enumerate(drawn_shapes(self._robot)):
            colour = (*_COLOURS[shape.part], 110 if shape.part == "base" else 255)
            drawn = rr.Mesh3D(
                vertex_positions=shape.vertices, triangle_indices=shape.faces, vertex_normals=shape.normals(),
                albedo_factor=colour,
            )  # fmt: skip
            self._stream.log(f"world/robot/{self._links[shape.joint - 1]}/{number}", drawn, static=True)
        self._stream.set_time(TIMELINE, duration=0.0)
        self._log_text("com", "From the model file, until the first estimate.")
        static = {
            "world": rr.ViewCoordinates.RIGHT_HAND_Z_UP,
            "world/feet": rr.Points3D.from_fields(radii=size * _FOOT, labels=LEG_NAMES, show_labels=True),
            "world/support_line": rr.LineStrips3D.from_fields(radii=size * _LINE, colors=_ORANGE),
            "world/robot/com/estimate/centre": rr.Points3D([[0, 0, 0]], radii=size * _CENTRE, colors=_RED),
            "world/robot/com/estimate/plumb_line": rr.LineStrips3D([[[0, 0, 0], [0, 0, -1]]], radii=-1.5, colors=_RED),
            "legend": rr.TextDocument(_LEGEND, media_type="text/markdown"),
            "com_half_width": rr.SeriesPoints(names=list("xyz")),
            "torque": rr.SeriesLines(names=self._robot.joint_names),
            "gyroscope": rr.SeriesLines(names=list("xyz")),
            "accelerometer": rr.SeriesLines(names=list("xyz")),
        }
        for entity, drawn in static.items():
            self._stream.log(entity, drawn, static=True)

    def _log_motion(self, motion: BaseMotion, chosen: slice) -> None:
        """Write the chosen steps of a motion, and the events up to each."""
        rr, steps = self._rr, motion.steps
        time, torque = steps.joints.time[chosen], steps.joints.torque
        rotation, standing = motion.rotation_base_to_world[chosen], motion.standing[chosen] > _STANDS
        contacts = motion.feet_in_world[chosen] - self._radii[:, None] * [0, 0, 1]
        lines: list[FloatArray | None] = []
        tilts: list[float] = []
        for now, attitude, feet in zip(time, rotation, contacts, strict=True):
            self._log_events(float(now), attitude, feet)
            lines.append(support_line(self._trial, feet))
            tilts.append(self._tilt(attitude))
        colours = np.where(standing[..., None], _STANDING, _IN_AIR).reshape(-1, 3).astype(np.uint8)
        points = rr.Points3D.columns(positions=contacts.reshape(-1, 3), colors=colours)
        strips = rr.LineStrips3D.columns(strips=[line for line in lines if line is not None])
        columns = {
            "world/feet": points.partition([4] * len(time)),
            "world/support_line": strips.partition([int(line is not None) for line in lines]),
            "tilt": rr.Scalars.columns(scalars=np.degrees(tilts)),
            "gyroscope": rr.Scalars.columns(scalars=np.degrees(steps.imu.angular_velocity_in_imu[chosen])),
            "accelerometer": rr.Scalars.columns(scalars=steps.imu.acceleration_in_imu[chosen]),
            **({} if torque is None else {"torque": rr.Scalars.columns(scalars=torque[chosen])}),
            **self._poses(motion.position_in_world[chosen], rotation, steps.joints.position[chosen]),
        }
        index = rr.TimeColumn(TIMELINE, duration=np.round(np.maximum(time - self._start, 0.0), 6))
        for entity, values in columns.items():
            self._stream.send_columns(entity, indexes=[index], columns=values)

    def _poses(self, base: FloatArray, rotation: FloatArray, joints: FloatArray) -> dict[str, Any]:
        """Return columns with the poses of base, links and the model file's CoM, relative to which estimates are drawn."""

        def columns(places: FloatArray, rotations: FloatArray, **others: FloatArray) -> Any:
            turned = Rotation.from_matrix(rotations).as_quat()
            return self._rr.Transform3D.columns(translation=places, quaternion=turned, **others)

        poses = [self._kinematics.joint_poses(position)[1:] for position in joints]
        places = np.array([[pose.translation for pose in moment] for moment in poses])
        rotations = np.array([[pose.rotation for pose in moment] for moment in poses])
        com = np.array([self._kinematics.com(position) for position in joints])
        height = base[:, 2] + np.einsum("ni,ni->n", rotation[:, 2], com)
        upright, scale = rotation.transpose(0, 2, 1), np.repeat(height[:, None], 3, axis=1)
        links = {f"world/robot/{name}": (places[:, k], rotations[:, k]) for k, name in enumerate(self._links)}
        return {
            "world/robot": columns(base, rotation),
            "world/robot/com": self._rr.Transform3D.columns(translation=com),
            "world/robot/com/estimate/plumb_line": columns(np.zeros_like(com), upright, scale=scale),
            **{entity: columns(*poses_of_link) for entity, poses_of_link in links.items()},
        }

    def _log_events(self, now: float, attitude: FloatArray, contacts: FloatArray) -> None:
        """Write the events up to a time [s], given the base attitude and the contact points at that time."""
        while self._events and self._events[0].time <= now:
            event = self._events.pop(0)
            self._set_time(event.time)
            if event.name == TRIAL:
                self._trial, self._lift, self._trials = read_trial(event.data), None, self._trials + 1
                self._stream.log("trials", self._rr.TextLog(self._title()))
            elif event.name == PHASE:
                line, phase = support_line(self._trial, contacts), str(event.data.get("name"))
                if phase == Phase.UNLOAD and line is not None:
                    self._lift = attitude, (line[1] - line[0]) / np.linalg.norm(line[1] - line[0])
                about = _KINDS.get(self._trial.kind, "") if self._trial else ""
                self._log_text("now", f"## {self._title()}\n**{phase}**\n\n{about}")

    def _tilt(self, attitude: FloatArray) -> float:
        """Return the rotation about the support line since the feet were unloaded [rad]; nan without a lift."""
        if self._lift is None:
            return np.nan
        before, direction = self._lift
        return float(Rotation.from_matrix(attitude @ before.T).as_rotvec() @ direction)

    def _title(self) -> str:
        if not self._trials:
            return "Before the first trial"
        of = "" if self._expected is None else f" of about {max(self._expected, self._trials)}"
        return f"Trial {self._trials}{of}: {trial_title(self._trial)}"

    def _log_text(self, entity: str, text: str) -> None:
        self._stream.log(entity, self._rr.TextDocument(text, media_type="text/markdown"))

    def _set_time(self, time: float) -> None:
        self._stream.set_time(TIMELINE, duration=round(max(0.0, time - self._start), 6))


def trial_title(trial: RecordedTrial | None) -> str:
    """Return a short name of a trial; None is a trial of unsupported kind."""
    words = ["motion"] if trial is None else [trial.kind, trial.about]
    if isinstance(trial, CommandedLift):
        words.append(trial.meanwhile if isinstance(trial, DesignedLift) else f"{1000 * trial.offset:+.1f} mm")
    return " ".join(filter(None, words))


def estimate_text(estimate: ComEstimate) -> str:
    """Return an estimate of the CoM as a table in Markdown."""
    rows = [
        f"| {axis} | **{1000 * value:+.2f}** | {'not estimated' if np.isnan(width) else f'{1000 * width:.2f}'} |"
        for axis, value, width in zip("xyz", estimate.com.tolist(), estimate.half_width.tolist(), strict=True)
    ]
    interval = "half bracket" if estimate.brackets else "95 % interval"
    trials = f"In the base frame at the nominal stance, after {estimate.trials} trial{'s' * (estimate.trials > 1)}."
    return "\n".join([f"| axis | CoM [mm] | ± {interval} [mm] |", "|:--|--:|--:|", *rows, "", trials])


def plane_piece(lift: LiftPlane, com: FloatArray, size: float) -> FloatArray:
    """Return the corners of a piece of a support plane, relative to the CoM and in base axes.

    Args:
        com: (3,) CoM at the nominal stance, in the base frame [m].
        size: half edge of the piece [m].

    Returns:
        (4, 3) corners [m]; the first two are the ends of the plane's horizontal line that is nearest to the CoM.
    """
    plane = lift.plane
    along = np.cross(plane.normal, [0, 0, 1.0])
    along *= size / float(np.linalg.norm(along))
    across = plane.normal * [1, 1, 0]
    near = across * float(plane.normal @ (plane.point - com)) / float(across @ across)
    down = np.cross(plane.normal, along)
    down *= -np.sign(down[2])
    return np.array([near - along, near + along, near + along + down, near - along + down])


def support_line(trial: RecordedTrial | None, contacts: FloatArray) -> FloatArray | None:
    """Return the (2, 3) right and left contact points of a lift's standing feet, from the (4, 3) points of all feet [m]."""
    if not isinstance(trial, LiftTrial):
        return None
    left, right = sorted(DIAGONALS[trial.diagonal], key=lambda leg: leg[1])
    return contacts[[LEG_NAMES.index(right), LEG_NAMES.index(left)]]
