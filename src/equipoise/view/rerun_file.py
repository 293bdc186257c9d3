"""The same pictures as a file for Rerun: the robot, the support line, the CoM closing in, tilt and torques on one timeline."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from equipoise.conventions import FloatArray
from equipoise.errors import MissingDependencyError, OutputError
from equipoise.figures.geometry import robot_shapes
from equipoise.robot.model import LEG_NAMES
from equipoise.user_file import replaceable
from equipoise.view.colours import COLOURS, COM, CONTACT, IN_AIR, LINE, MAGNIFIED, VERDICTS
from equipoise.view.frames import Camera, Frame, ellipsoid, joint_poses, plane_lines
from equipoise.view.panel import com_text, trial_text

if TYPE_CHECKING:
    import rerun


TIMELINE = "time"
_PICTURES = 25.0  # a second
_CONTACT_RADIUS, _LINE_RADIUS, _COM_RADIUS = 0.012, 0.004, 0.012  # [m] on an A1


def require_rerun() -> Any:
    """The package; raises MissingDependencyError if it is not installed."""
    try:
        import rerun  # noqa: PLC0415 - optional
    except ModuleNotFoundError as error:
        raise MissingDependencyError("a Rerun file needs rerun-sdk: pip install 'equipoise[rerun]'") from error
    return rerun


def require_rerun_file(path: Path) -> None:
    """Raise OutputError if a file cannot be begun there, or is there already."""
    require_rerun()
    if path.exists():
        raise OutputError(f"{str(path)!r} exists; name a new file with --rerun")
    if not path.parent.is_dir():
        raise OutputError(f"{str(path)!r} cannot be written: there is no folder {str(path.parent)!r}")


def write_rerun(path: Path, title: str, camera: Camera) -> None:
    """Write all of a film.

    Raises:
        MissingDependencyError: rerun-sdk is not installed.
        OutputError: the file cannot be written.
    """
    rr = require_rerun()
    replaceable(path)
    try:
        with rr.RecordingStream("equipoise") as stream:
            stream.save(path, default_blueprint=_blueprint(rr))
            stream.send_recording_name(title)
            _Writer(rr, stream, camera).write()
    except OSError as error:
        raise OutputError(f"{str(path)!r} cannot be written: {error}") from error
    if not path.exists():  # Rerun tells some failures to its own log only
        raise OutputError(f"{str(path)!r} cannot be written")


def _blueprint(rr: Any) -> Any:
    b = import_module("rerun.blueprint")
    words = b.Vertical(b.TextDocumentView(origin="trial"), b.TextDocumentView(origin="com_now"))
    curves = b.Vertical(
        b.TimeSeriesView(origin="tilt_deg", name="tilt about the support line [deg]"),
        b.TimeSeriesView(origin="com_95_mm", name="CoM, 95 % +- [mm]"),
        b.TimeSeriesView(origin="torque", name="joint torques [Nm]"),
    )
    scene = b.Vertical(b.Spatial3DView(origin="world"), b.TextLogView(origin="trials"), row_shares=[4, 1])
    return b.Blueprint(b.Horizontal(words, scene, curves, column_shares=[1, 3, 2]), collapse_panels=True)


class _Writer:
    def __init__(self, rr: Any, stream: rerun.RecordingStream, camera: Camera) -> None:
        self._rr, self._stream, self._camera = rr, stream, camera
        start, end = camera.film.span
        count = max(2, round((end - start) * _PICTURES))
        self._frames = [camera.frame(float(time)) for time in np.linspace(start, end, count)]

    def write(self) -> None:
        """Everything."""
        self._log("world", self._rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        self._write_robot()
        self._write_curves()
        before: Frame | None = None
        for frame in self._frames:
            self._stream.set_time(TIMELINE, duration=frame.time)
            self._write_floor(frame, before)
            if before is None or frame.trial != before.trial:
                self._write_trial(frame)
            if before is None or frame.complete != before.complete:
                self._write_estimate(frame)
            before = frame

    def _log(self, entity: str, what: Any, static: bool = False) -> None:
        self._stream.log(entity, what, static=static)

    def _write_robot(self) -> None:
        """Shapes once, and how the joints' frames move."""
        film = self._camera.film
        names = ["base", *(str(name).replace("/", "_") for name in list(film.robot.pinocchio.names)[2:])]
        for number, shape in enumerate(robot_shapes(film.robot)):
            mesh, colour = shape.mesh(), (*COLOURS[shape.part], 110 if shape.part == "base" else 255)
            drawn = self._rr.Mesh3D(
                vertex_positions=mesh.vertices, triangle_indices=mesh.faces, vertex_normals=mesh.normals(),
                albedo_factor=colour,
            )  # fmt: skip
            self._log(f"world/robot/{names[shape.joint - 1]}/{number}", drawn, static=True)
        frames = self._frames
        self._move(
            "world/robot",
            np.array([f.position_in_world for f in frames]),
            np.array([f.rotation_base_to_world for f in frames]),
        )
        poses = [joint_poses(film, frame.joint_position) for frame in frames]
        for joint, name in enumerate(names):
            places = np.array([pose[joint][1] for pose in poses])
            self._move(f"world/robot/{name}", places, np.array([pose[joint][0] for pose in poses]))
        com = np.array([frame.com_in_world for frame in frames])
        self._move("world/com", com, np.array([frame.rotation_base_to_world for frame in frames]))
        size = film.stance.scale.length
        centre = self._rr.Points3D([[0, 0, 0]], radii=_COM_RADIUS * size, colors=COM)
        self._log("world/com/centre", centre, static=True)

    def _move(self, entity: str, places: FloatArray, rotations: FloatArray) -> None:
        quaternions = Rotation.from_matrix(rotations).as_quat()
        columns = self._rr.Transform3D.columns(translation=places, quaternion=quaternions)
        self._stream.send_columns(entity, indexes=[self._times()], columns=columns)

    def _times(self) -> Any:
        return self._rr.TimeColumn(TIMELINE, duration=[frame.time for frame in self._frames])

    def _write_curves(self) -> None:
        tilts = np.degrees([np.nan if frame.tilt is None else frame.tilt for frame in self._frames])
        self._curve("tilt_deg", tilts)
        torques = np.array([frame.joint_torque for frame in self._frames])
        for joint, name in enumerate(self._camera.film.robot.joint_names):
            self._curve(f"torque/{name}", torques[:, joint])

    def _curve(self, entity: str, values: FloatArray) -> None:
        self._stream.send_columns(entity, indexes=[self._times()], columns=self._rr.Scalars.columns(scalars=values))

    def _write_floor(self, frame: Frame, before: Frame | None) -> None:
        """Contacts, the support line and the CoM's plumb line."""
        rr, size = self._rr, self._camera.film.stance.scale.length
        colours = [CONTACT if standing else IN_AIR for standing in frame.standing.tolist()]
        self._log(
            "world/contacts",
            rr.Points3D(frame.contacts_in_world, radii=_CONTACT_RADIUS * size, colors=colours, labels=LEG_NAMES),
        )
        plumb = [[frame.com_in_world, frame.com_in_world * [1, 1, 0]]]
        self._log("world/plumb_line", rr.LineStrips3D(plumb, radii=0.25 * _LINE_RADIUS * size, colors=COM))
        if frame.support_line_in_world is not None:
            line = rr.LineStrips3D([frame.support_line_in_world], radii=_LINE_RADIUS * size, colors=LINE)
            self._log("world/support_line", line)
        elif before is not None and before.support_line_in_world is not None:
            self._log("world/support_line", rr.Clear(recursive=False))

    def _write_trial(self, frame: Frame) -> None:
        rr, film = self._rr, self._camera.film
        self._log("trial", rr.TextDocument(trial_text(frame, len(film.trials), True), media_type="text/markdown"))
        if frame.trial is not None:
            self._log("trials", rr.TextLog(f"trial {frame.trial.number}: {frame.trial.title}", level="INFO"))

    def _write_estimate(self, frame: Frame) -> None:
        rr, estimate = self._rr, frame.estimate
        self._log("com_now", rr.TextDocument(com_text(frame), media_type="text/markdown"))
        if estimate is None:
            return
        for axis, half in zip("xyz", estimate.half.tolist(), strict=True):
            self._log(f"com_95_mm/{axis}", rr.Scalars(1000 * half))
        if (axes := ellipsoid(estimate)) is not None:
            turned = Rotation.from_matrix(axes[0]).as_quat()
            drawn = rr.Ellipsoids3D(
                half_sizes=[MAGNIFIED * axes[1]], quaternions=[turned], colors=[(*COM, 90)], fill_mode="solid"
            )
            self._log("world/com/ellipsoid", drawn)
        lines = plane_lines(frame, self._camera.film.stance)
        colours = [VERDICTS[plane.verdict] for plane in frame.planes]
        self._log("world/com/planes", rr.LineStrips3D(lines, radii=0.001, colors=colours))
