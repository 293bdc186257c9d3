"""The side panel of the page: the trial, its tilt, the CoM from above, and the timeline."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from equipoise.robot.inertial import composite_parameters
from equipoise.view.colours import LINE, MAGNIFIED, html
from equipoise.view.frames import Camera, Frame
from equipoise.view.panel import com_text, trial_text
from equipoise.view.plan_view import plan_view
from equipoise.view.player import Player

if TYPE_CHECKING:
    import viser

_SPEEDS = ("0.1 x", "0.25 x", "0.5 x", "1 x", "2 x", "5 x", "10 x")
_TILT_SAMPLES = 200
_CHART_TIME = 0.1  # [s] between drawings of the chart: browsers take long for them


class Controls:
    """The side panel."""

    def __init__(self, server: viser.ViserServer, camera: Camera, player: Player, title: str) -> None:
        self._camera, self._player = camera, player
        gui = server.gui
        gui.set_panel_label(title)
        self._trial = gui.add_markdown("**waiting for the robot**")
        with gui.add_folder("Timeline"):
            self._play = gui.add_button("Pause")
            self._time = gui.add_slider("time [s]", 0.0, 1.0, 0.01, 0.0)
            self._speed = gui.add_dropdown("speed", _SPEEDS, initial_value="1 x")
            self._jump: Any = gui.add_dropdown("jump to", ("-",), initial_value="-")
            self._live = gui.add_checkbox("follow the robot", player.live, visible=player.live)
            self._note = gui.add_markdown("")
        self._com = gui.add_markdown("")
        self._plan = gui.add_html("")
        self._tilt = self._chart(gui, "tilt [deg]", "s since the lift", html(LINE))
        gui.add_markdown(
            "Orange: support line. Green: feet that stand. Red: CoM, its plumb line, and its 95 % ellipsoid drawn "
            f"{MAGNIFIED:g} times as large. Lines through it: what each lift said."
        )
        self._charted = -1.0  # the time that the chart shows
        self._targets: dict[str, float] = {}
        self._drawn: tuple[Any, ...] = ()
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
        expected = len(film.trials) if complete else film.method.expected_trials(film.stance)
        _set(self._trial, "content", trial_text(frame, expected, complete))
        _set(self._com, "content", com_text(frame))
        _set(self._play, "label", "Pause" if player.playing else "Play")
        _set(self._live, "visible", not complete)
        _set(self._live, "value", player.live)
        start, end = film.span
        _set(self._time, "min", round(start, 2))
        _set(self._time, "max", max(round(end, 2), round(start, 2) + 0.01))
        _set(self._time, "value", round(min(frame.time, end), 2))
        state = "live" if player.live and not complete else "replay"
        pace = f"{player.rate:.1f} times real time" if player.playing else "paused"
        _set(self._note, "content", f"{frame.time:.1f} of {end:.1f} s, {state}, {pace}")
        self._list_trials()
        self._draw_tilt(frame)
        self._draw_plan(frame)

    def _list_trials(self) -> None:
        film = self._camera.film
        if len(film.trials) != len(self._targets):
            self._targets = {f"{trial.number}: {trial.title}": film.beginning(trial) for trial in film.trials}
            self._jump.options = ("-", *self._targets)

    def _draw_tilt(self, frame: Frame) -> None:
        tilts = None if frame.trial is None else self._camera.tilts(frame.trial, frame.time)
        if tilts is None or len(tilts[0]) < 2:
            _set(self._tilt, "visible", False)
            return
        if _set(self._tilt, "visible", True) or abs(frame.time - self._charted) > _CHART_TIME:
            self._charted = frame.time
            every = max(1, len(tilts[0]) // _TILT_SAMPLES)
            self._tilt.data = (tilts[0][::every], np.degrees(tilts[1][::every]))

    def _draw_plan(self, frame: Frame) -> None:
        history = self._camera.closing_in.history(frame.complete)
        known = (len(history), history[-1].trials if history else 0, len(frame.planes))
        if known != self._drawn:
            self._drawn = known
            film = self._camera.film
            nominal = composite_parameters(film.robot, film.stance.joint_position).com
            self._plan.content = plan_view(history, frame.planes, nominal)

    def _chart(self, gui: Any, label: str, along: str, colour: str) -> Any:
        uplot = import_module("viser.uplot")
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


def _set(handle: Any, name: str, value: Any) -> bool:
    """Send a property only if it has changed; returns whether it has."""
    if changed := getattr(handle, name) != value:
        setattr(handle, name, value)
    return changed
