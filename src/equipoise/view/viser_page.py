"""The page: the robot, the support line and the CoM in a browser, with a timeline. Drawn by viser."""

from __future__ import annotations

import contextlib
import io
import logging
import os
import socket
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from equipoise.conventions import FloatArray
from equipoise.errors import MissingDependencyError, SettingsError
from equipoise.figures.geometry import Mesh, cylinder, robot_shapes, sphere
from equipoise.robot.model import LEG_NAMES
from equipoise.view.colours import COLOURS, COM, CONTACT, IN_AIR, LINE, MAGNIFIED, VERDICTS, Colour
from equipoise.view.frames import Camera, Frame, ellipsoid, joint_poses, plane_lines
from equipoise.view.player import Player
from equipoise.view.viser_controls import Controls

if TYPE_CHECKING:
    import viser

BASE_OPACITY = 0.45
"""The CoM is inside the base, and wants to be seen."""
_LONGEST = 0.15  # [m] of the ellipsoid's half axes, as it is drawn
_ABOVE_FLOOR = np.array([0, 0, 0.002])  # [m]: what lies on the floor must not flicker through it


def require_viser() -> Any:
    """The package; raises MissingDependencyError if it is not installed."""
    try:
        import viser  # noqa: PLC0415 - optional
    except ModuleNotFoundError as error:
        raise MissingDependencyError("the live view needs viser: pip install 'equipoise[view]'") from error
    return viser


def require_port(host: str, port: int) -> None:
    """Raise SettingsError if a page cannot be served there."""
    if not 0 <= port <= 65535:
        raise SettingsError(f"--view-port is {port}; a port is from 1 to 65535, or 0 for any that is free")
    try:
        with socket.create_server((host, port)):
            pass
    except OSError as error:
        why = os.strerror(error.errno or 0)
        raise SettingsError(
            f"the view cannot be served at {host}:{port}: {why}; choose another port with --view-port, or 0 for any that is "
            "free"
        ) from error


class Page:
    """A page in a browser; served until it is closed. Use it as a context manager.

    Args:
        camera: what is shown.
        player: when.
        host, port: where it is served; port 0: any that is free.

    Raises:
        MissingDependencyError: viser is not installed.
        SettingsError: the port is in use.
    """

    def __init__(self, title: str, camera: Camera, player: Player, host: str, port: int) -> None:
        viser = require_viser()
        require_port(host, port)
        self._viser, self._camera, self._player = viser, camera, player
        logging.getLogger("websockets").setLevel(logging.CRITICAL)  # it tells of every browser that thinks better of it
        with contextlib.redirect_stdout(io.StringIO()):  # where viser announces itself, whatever it is told
            self._server: viser.ViserServer = viser.ViserServer(host, port, label="equipoise", verbose=False)
        self.port: int = self._server.get_port()
        if port not in (0, self.port):  # somebody was faster, and viser took the next one
            self._server.stop()
            require_port(host, port)
        self._shown: tuple[Any, ...] = ()  # what the page depends on, when it was drawn last
        self._drawn: tuple[Any, ...] = ()  # likewise the CoM
        self._build_scene()
        self._controls = Controls(self._server, camera, player, title)

    @property
    def span(self) -> tuple[float, float]:
        """First and last time that there is [s]."""
        return self._camera.film.span

    @property
    def watched(self) -> bool:
        """Whether anybody looks."""
        return bool(self._server.get_clients())

    def draw(self, complete: bool) -> None:
        """Show the player's moment.

        Args:
            complete: whether no more will be recorded.
        """
        film = self._camera.film
        if film.empty:
            self._controls.wait()
            return
        if (now := self._state(complete)) == self._shown:  # a list that is open must not be drawn anew
            return
        self._shown = now
        frame = self._camera.frame(self._player.time)
        with self._server.atomic():
            self._draw_robot(frame)
            self._draw_line(frame)
            self._draw_com(frame)
            self._controls.draw(frame, complete)
        self._server.flush()

    def _state(self, complete: bool) -> tuple[Any, ...]:
        player, known = self._player, self._camera.closing_in
        words = (complete, player.playing, player.live, player.speed, round(player.rate, 1))
        return (player.time, *words, self._camera.film.span, known.count, len(known.planes))

    def close(self) -> None:
        """End it."""
        self._server.stop()

    def __enter__(self) -> Page:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _build_scene(self) -> None:
        scene, size = self._server.scene, self._camera.film.stance.scale.length
        self._server.gui.configure_theme(show_share_button=False, show_logo=False)
        self._server.gui.main_panel.dock_right()
        self._server.initial_camera.position = tuple(np.array([0.5, -0.75, 0.5]) * size)
        self._server.initial_camera.look_at = tuple(np.array([0.0, 0.0, 0.16]) * size)
        scene.configure_default_lights(cast_shadow=True)
        scene.add_light_hemisphere("/light", sky_color=(255, 255, 255), ground_color=(170, 170, 180), intensity=0.8)
        scene.add_grid(
            "/floor", infinite_grid=True, cell_size=0.1, section_size=0.5, cell_color=(222, 226, 232),
            section_color=(190, 197, 208), plane_color=(248, 249, 251), plane_opacity=1.0, shadow_opacity=0.25,
            fade_distance=6.0 * size, fade_from="origin",
        )  # fmt: skip
        self._base = scene.add_frame("/robot", show_axes=False)
        self._joints = [scene.add_frame(f"/robot/{name}", show_axes=False) for name in self._joint_names()]
        self._add_shapes()
        foot = cylinder(0.025 * size, 0.002)
        self._contacts = [_mesh(scene, f"/contacts/{leg}", foot, CONTACT, opacity=0.85) for leg in LEG_NAMES]
        self._in_air = [_mesh(scene, f"/in_air/{leg}", foot, IN_AIR, opacity=0.5) for leg in LEG_NAMES]
        self._line = _mesh(scene, "/support_line", cylinder(0.004 * size, 1.0), LINE)
        self._plumb = _mesh(scene, "/plumb_line", cylinder(0.0015 * size, 1.0), COM)
        self._shadow = _mesh(scene, "/com_on_floor", cylinder(0.01 * size, 0.003), COM)
        self._com = scene.add_frame("/com", show_axes=False)
        _mesh(scene, "/com/centre", sphere(0.012 * size), COM)
        self._ellipsoid = _mesh(scene, "/com/ellipsoid", sphere(1.0), COM, opacity=0.3)

    def _joint_names(self) -> list[str]:
        names = self._camera.film.robot.pinocchio.names
        return ["base", *(str(name).replace("/", "_") for name in list(names)[2:])]

    def _add_shapes(self) -> None:
        for number, shape in enumerate(robot_shapes(self._camera.film.robot)):
            joint = self._joint_names()[shape.joint - 1]
            opacity = BASE_OPACITY if shape.part == "base" else None
            flat = shape.kind in ("box", "mesh")
            _mesh(self._server.scene, f"/robot/{joint}/{number}", shape.mesh(), COLOURS[shape.part], opacity, flat)

    def _draw_robot(self, frame: Frame) -> None:
        self._base.position, self._base.wxyz = frame.position_in_world, _wxyz(frame.rotation_base_to_world)
        poses = joint_poses(self._camera.film, frame.joint_position)
        for handle, (rotation, place) in zip(self._joints, poses, strict=True):
            handle.position, handle.wxyz = place, _wxyz(rotation)
        places = frame.contacts_in_world * [1, 1, 0] + _ABOVE_FLOOR
        for green, grey, place, stands in zip(
            self._contacts, self._in_air, places, frame.standing.tolist(), strict=True
        ):
            green.position = grey.position = place
            _set_visible(green, stands)
            _set_visible(grey, not stands)

    def _draw_line(self, frame: Frame) -> None:
        line = frame.support_line_in_world
        _set_visible(self._line, line is not None)
        if line is not None:
            beyond = 0.15 * (line[1] - line[0])
            _stretch(self._line, line[0] - beyond + _ABOVE_FLOOR, line[1] + beyond + _ABOVE_FLOOR)
            self._line.opacity = 1.0 if frame.tilt is not None else 0.35

    def _draw_com(self, frame: Frame) -> None:
        on_floor = frame.com_in_world * [1, 1, 0] + _ABOVE_FLOOR
        self._com.position, self._com.wxyz = frame.com_in_world, _wxyz(frame.rotation_base_to_world)
        self._shadow.position = on_floor
        _stretch(self._plumb, on_floor, frame.com_in_world)
        known = (len(frame.planes), None if frame.estimate is None else frame.estimate.trials)
        if known == self._drawn:
            return
        self._drawn = known
        axes = ellipsoid(frame.estimate)
        if axes is not None:  # its size before it is seen: as it was made it is a metre wide, with the camera in it
            self._ellipsoid.wxyz = _wxyz(axes[0])
            half = np.minimum(MAGNIFIED * axes[1], _LONGEST)
            self._ellipsoid.scale = (float(half[0]), float(half[1]), float(half[2]))
        self._ellipsoid.visible = axes is not None
        self._draw_planes(frame)

    def _draw_planes(self, frame: Frame) -> None:
        points = plane_lines(frame, self._camera.film.stance)
        scene = self._server.scene
        colours = np.array([[VERDICTS[plane.verdict]] * 2 for plane in frame.planes], dtype=np.uint8).reshape(-1, 2, 3)
        scene.add_line_segments(
            "/com/planes", points.astype(np.float32), colours, thickness=2.0, thickness_units="screen"
        )


def show(page: Page, player: Player, refresh: Callable[[], bool], rate: float = 30.0) -> None:
    """Keep the page up for ever.

    Args:
        refresh: takes up what is new; returns whether no more will come.
        rate: pictures a second, while anybody looks.
    """
    last = time.monotonic()
    while True:
        complete = refresh()
        now = time.monotonic()
        if page.watched:  # else whoever comes would be late
            player.advance(now - last, page.span, complete)
        last = now
        page.draw(complete)
        time.sleep(max(0.0, (1 / rate if page.watched else 0.2) - (time.monotonic() - now)))


def _set_visible(handle: Any, visible: bool) -> None:
    if handle.visible != visible:
        handle.visible = visible


def _mesh(scene: Any, name: str, mesh: Mesh, colour: Colour, opacity: float | None = None, flat: bool = False) -> Any:
    return scene.add_mesh_simple(
        name, mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32), color=colour, opacity=opacity,
        flat_shading=flat, side="double",
    )  # fmt: skip


def _stretch(handle: Any, start: FloatArray, end: FloatArray) -> None:
    """Lay a body of length one along z from one point to another."""
    along = end - start
    length = float(np.linalg.norm(along))
    turned, _ = Rotation.align_vectors(along[None] / max(length, 1e-9), np.array([[0.0, 0, 1]]))
    handle.position, handle.wxyz = (start + end) / 2, _wxyz(turned.as_matrix())
    handle.scale = (1.0, 1.0, length)


def _wxyz(rotation: FloatArray) -> FloatArray:
    x, y, z, w = Rotation.from_matrix(rotation).as_quat()
    return np.array([w, x, y, z])
