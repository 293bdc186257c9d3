"""The page: the robot, the support line and the CoM in a browser, with a timeline. Drawn by viser."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from equipoise.errors import MissingDependencyError, SettingsError
from equipoise.outputs.geometry import Mesh, Part, cylinder, robot_shapes, sphere
from equipoise.outputs.viewing.closing_in import LiftPlane
from equipoise.outputs.viewing.frames import Camera, Frame, ellipsoid, expected_trials, joint_poses
from equipoise.outputs.viewing.panel import com_text, trial_text
from equipoise.outputs.viewing.plan_view import plan_view
from equipoise.outputs.viewing.player import Player
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.model import LEG_NAMES

if TYPE_CHECKING:
    import viser

FloatArray = NDArray[np.float64]
Colour = tuple[int, int, int]

COLOURS: dict[Part, Colour] = {"base": (70, 86, 112), "hip": (92, 108, 134), "thigh": (148, 162, 184), "shank": (192, 202, 216)}
BASE_OPACITY = 0.45
"""The CoM is inside the base, and wants to be seen."""
CONTACT, IN_AIR, LINE, COM = (46, 160, 90), (170, 176, 186), (240, 140, 20), (214, 51, 108)
VERDICTS: dict[str | None, Colour] = {
    "forward": (47, 126, 216), "backward": (232, 116, 59), "balanced": (58, 166, 85), None: (122, 135, 148),
}  # fmt: skip
MAGNIFIED = 10.0
"""Factor that the CoM's ellipsoid is drawn with: a fraction of a millimetre could not be seen."""
_LONGEST = 0.15  # [m] of the ellipsoid's half axes, as it is drawn
_SPEEDS = ("0.1 x", "0.25 x", "0.5 x", "1 x", "2 x", "5 x", "10 x")
_TILT_SAMPLES = 200
_ABOVE_FLOOR = np.array([0, 0, 0.002])  # [m]: what lies on the floor must not flicker through it


def require_viser() -> Any:
    """The package; raises MissingDependencyError if it is not installed."""
    try:
        import viser  # noqa: PLC0415 - optional
        import viser.uplot  # noqa: PLC0415
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
        raise SettingsError(
            f"the view cannot be served at {host}:{port}: {error.strerror}; choose another port with --view-port, or 0 for "
            "any that is free"
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
        self._server: viser.ViserServer = viser.ViserServer(host, port, label="equipoise", verbose=False)
        self.port: int = self._server.get_port()
        if port not in (0, self.port):  # somebody was faster, and viser took the next one
            self._server.stop()
            require_port(host, port)
        self._drawn: tuple[Any, ...] = ()
        self._nominal = composite_parameters(camera.film.robot, camera.film.stance.joint_position).com
        self._build_scene()
        self._controls = _Controls(self._server, camera, player, title)

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
        frame = self._camera.frame(self._player.time)
        with self._server.atomic():
            self._draw_robot(frame)
            self._draw_line(frame)
            self._draw_com(frame)
            self._controls.draw(frame, complete)
        self._server.flush()

    def close(self) -> None:
        """End it."""
        self._server.stop()

    def __enter__(self) -> Page:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _build_scene(self) -> None:
        scene, size = self._server.scene, self._camera.film.stance.size
        self._server.gui.configure_theme(show_share_button=False, show_logo=False, control_layout="fixed")
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
        self._base.position, self._base.wxyz = frame.position, _wxyz(frame.rotation)
        poses = joint_poses(self._camera.film, frame.joint_position)
        for handle, (rotation, place) in zip(self._joints, poses, strict=True):
            handle.position, handle.wxyz = place, _wxyz(rotation)
        for handle, point, standing in zip(self._contacts, frame.contacts, frame.standing.tolist(), strict=True):
            handle.position = point * [1, 1, 0] + _ABOVE_FLOOR
            handle.color = CONTACT if standing else IN_AIR

    def _draw_line(self, frame: Frame) -> None:
        line = frame.support_line
        self._line.visible = line is not None
        if line is not None:
            beyond = 0.15 * (line[1] - line[0])
            _stretch(self._line, line[0] - beyond + _ABOVE_FLOOR, line[1] + beyond + _ABOVE_FLOOR)
            self._line.opacity = 1.0 if frame.tilt is not None else 0.35

    def _draw_com(self, frame: Frame) -> None:
        on_floor = frame.com * [1, 1, 0] + _ABOVE_FLOOR
        self._com.position, self._com.wxyz = frame.com, _wxyz(frame.rotation)
        self._shadow.position = on_floor
        _stretch(self._plumb, on_floor, frame.com)
        known = (len(frame.planes), None if frame.estimate is None else frame.estimate.trials)
        if known == self._drawn:
            return
        self._drawn = known
        axes = ellipsoid(frame.estimate)
        self._ellipsoid.visible = axes is not None
        if axes is not None:
            self._ellipsoid.wxyz = _wxyz(axes[0])
            half = np.minimum(MAGNIFIED * axes[1], _LONGEST)
            self._ellipsoid.scale = (float(half[0]), float(half[1]), float(half[2]))
        self._draw_planes(frame)

    def _draw_planes(self, frame: Frame) -> None:
        com = self._nominal if frame.estimate is None else frame.estimate.com
        segments = [_segment(plane, com, self._camera.film.stance.size) for plane in frame.planes]
        points = np.array(segments).reshape(-1, 2, 3)
        colours = np.array([[VERDICTS[plane.verdict]] * 2 for plane in frame.planes], dtype=np.uint8).reshape(-1, 2, 3)
        self._server.scene.add_line_segments("/com/planes", points.astype(np.float32), colours, thickness=2.0, thickness_units="screen")


class _Controls:
    """The side panel."""

    def __init__(self, server: viser.ViserServer, camera: Camera, player: Player, title: str) -> None:
        self._camera, self._player = camera, player
        self._viser = require_viser()
        gui = server.gui
        gui.set_panel_label(title)
        self._trial = gui.add_markdown("**waiting for the robot**")
        self._tilt = self._chart(gui, "tilt [deg]", "s since the lift", "#f08c14")
        self._com = gui.add_markdown("")
        self._plan = gui.add_html("")
        with gui.add_folder("Timeline"):
            self._play = gui.add_button("Pause")
            self._time = gui.add_slider("time [s]", 0.0, 1.0, 0.01, 0.0)
            self._speed = gui.add_dropdown("speed", _SPEEDS, initial_value="1 x")
            self._jump = gui.add_dropdown("jump to", ("-",), initial_value="-")
            self._live = gui.add_checkbox("follow the robot", player.live, visible=player.live)
            self._note = gui.add_markdown("")
        gui.add_markdown(
            "Orange: support line. Green: feet that stand. Red: CoM, its plumb line, and its 95 % ellipsoid drawn "
            f"{MAGNIFIED:g} times as large. Lines through it: what each lift said."
        )
        self._targets: dict[str, float] = {}
        self._shown: tuple[Any, ...] = ()
        self._play.on_click(lambda _: player.toggle(camera.film.span))
        self._time.on_update(self._by_hand(lambda: player.jump(float(self._time.value))))
        self._speed.on_update(self._by_hand(self._take_speed))
        self._jump.on_update(self._by_hand(self._take_jump))
        self._live.on_update(self._by_hand(self._take_live))

    def wait(self) -> None:
        """There is nothing to see yet."""

    def draw(self, frame: Frame, complete: bool) -> None:
        """Words, charts and the timeline of a moment."""
        film, player = self._camera.film, self._player
        expected = len(film.trials) if complete else expected_trials(film)
        _set(self._trial, "content", trial_text(frame, expected, complete))
        _set(self._com, "content", com_text(frame))
        _set(self._play, "label", "Pause" if player.playing else "Play")
        self._live.visible = not complete
        if self._live.value != player.live:
            self._live.value = player.live
        start, end = film.span
        self._time.min, self._time.max = round(start, 2), max(round(end, 2), round(start, 2) + 0.01)
        self._time.value = round(min(frame.time, end), 2)
        state = "live" if player.live and not complete else "replay"
        pace = f"{player.rate:.1f} times real time" if player.playing else "paused"
        _set(self._note, "content", f"{frame.time:.1f} of {end:.1f} s, {state}, {pace}")
        self._list_trials()
        self._draw_tilt(frame)
        self._draw_plan(frame)

    def _list_trials(self) -> None:
        trials = self._camera.film.trials
        if len(trials) != len(self._targets):
            self._targets = {f"{trial.number}: {trial.title}": trial.time for trial in trials}
            self._jump.options = ("-", *self._targets)

    def _draw_tilt(self, frame: Frame) -> None:
        tilts = None if frame.trial is None else self._camera.tilts(frame.trial, frame.time)
        if tilts is None or len(tilts[0]) < 2:
            self._tilt.visible = False
            return
        every = max(1, len(tilts[0]) // _TILT_SAMPLES)
        self._tilt.visible = True
        self._tilt.data = (tilts[0][::every], np.degrees(tilts[1][::every]))

    def _draw_plan(self, frame: Frame) -> None:
        history = self._camera.closing_in.history(frame.complete)
        known = (len(history), history[-1].trials if history else 0, len(frame.planes))
        if known != self._shown:
            self._shown = known
            film = self._camera.film
            nominal = composite_parameters(film.robot, film.stance.joint_position).com
            self._plan.content = plan_view(history, frame.planes, nominal)

    def _chart(self, gui: Any, label: str, along: str, colour: str) -> Any:
        uplot = self._viser.uplot
        return gui.add_uplot(
            (np.zeros(2), np.zeros(2)),
            (uplot.Series(label=along), uplot.Series(label=label, stroke=colour, width=2)),
            scales={"x": uplot.Scale(time=False), "y": uplot.Scale(auto=True)},
            axes=(uplot.Axis(label=along), uplot.Axis(label=label, size=56)),
            legend=uplot.Legend(show=False),
            height=150,
            visible=False,
        )

    def _by_hand(self, react: Callable[[], None]) -> Callable[[Any], None]:
        """React to what a person does, and not to what `draw` sets."""

        def heard(event: Any) -> None:
            if event.client is not None:
                react()

        return heard

    def _take_speed(self) -> None:
        self._player.speed, self._player.live = float(self._speed.value.split()[0]), False

    def _take_jump(self) -> None:
        if self._jump.value in self._targets:
            self._player.jump(self._targets[self._jump.value])

    def _take_live(self) -> None:
        self._player.live = self._player.playing = bool(self._live.value)


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
        player.advance(now - last, page.span, complete)
        last = now
        page.draw(complete)
        time.sleep(max(0.0, (1 / rate if page.watched else 0.2) - (time.monotonic() - now)))


def _set(handle: Any, name: str, value: Any) -> None:
    """Send a property only if it has changed."""
    if getattr(handle, name) != value:
        setattr(handle, name, value)


def _mesh(scene: Any, name: str, mesh: Mesh, colour: Colour, opacity: float | None = None, flat: bool = False) -> Any:
    return scene.add_mesh_simple(
        name, mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32), color=colour, opacity=opacity,
        flat_shading=flat, side="double",
    )  # fmt: skip


def _stretch(handle: Any, start: FloatArray, end: FloatArray) -> None:
    """Lay a body of length one along z from one point to another."""
    along = end - start
    length = float(np.linalg.norm(along))
    turned, _ = Rotation.align_vectors(along[None] / max(length, 1e-9), [[0.0, 0, 1]])
    handle.position, handle.wxyz = (start + end) / 2, _wxyz(turned.as_matrix())
    handle.scale = (1.0, 1.0, length)


def _wxyz(rotation: FloatArray) -> FloatArray:
    x, y, z, w = Rotation.from_matrix(rotation).as_quat()
    return np.array([w, x, y, z])


def _segment(plane: LiftPlane, com: FloatArray, size: float) -> FloatArray:
    """(2, 3) a piece of the plane's level line nearest to the CoM, relative to that."""
    along = np.cross(plane.normal, [0, 0, 1.0])
    along *= 0.16 * size / float(np.linalg.norm(along))
    horizontal = plane.normal * [1, 1, 0]
    near = horizontal * float(plane.normal @ (plane.point - com)) / float(horizontal @ horizontal)
    return np.array([near - along, near + along])
