"""Table of the page `speed`: effect of the view on the control loop.

An emulated Go2 sends its messages over DDS in its own process. The guarded loop plays a slow motion at 500 Hz in real time and
writes its log, as in a calibration, without a view, with a view recorded in a file, and with a view in a browser.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path

from emulated import GO2, ROBOT, oscillate, standing_go2
from rows import NotTriedError, Row, Table
from simulated import robot_called
from tables import column, figures, markdown

from equipoise import BayesianMethod, RunFolder
from equipoise.guard.remote_robot import RemoteRobot
from equipoise.view.viewer import BROWSER, free_port, live_viewer

VIEWS = ("no view", "view in a file", "view in a browser")
ROUNDS, SECONDS = 2, 40.0
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
WITHOUT_GRAPHICS_CARD = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


@contextmanager
def viewed(view: str, folder: Path) -> Generator[None]:
    """Show a run in a view."""
    if view == VIEWS[0]:
        yield
    elif view == VIEWS[1]:
        with live_viewer(folder, str(folder / "view.rrd")):
            yield
    else:
        with live_viewer(folder, BROWSER), browser():
            yield


@contextmanager
def browser() -> Generator[None]:
    """Open the viewer's page; in practice the browser is on another computer, so it has the lowest priority here."""
    if CHROMIUM is None:
        raise NotTriedError("a view in a browser needs chromium")
    page, data = free_port(9090), free_port(9876)  # the viewer's defaults
    url = f"http://127.0.0.1:{page}/?url=rerun%2Bhttp://127.0.0.1:{data}/proxy&renderer=webgl"
    with tempfile.TemporaryDirectory() as profile:
        time.sleep(5.0)
        flags = ("--headless", "--no-sandbox", *WITHOUT_GRAPHICS_CARD, f"--user-data-dir={profile}")
        process = subprocess.Popen(
            ["nice", "-n", "19", CHROMIUM, *flags, "--remote-debugging-port=0", url],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        time.sleep(10.0)
        try:
            yield
        finally:
            process.terminate()
            process.wait(timeout=20)


def loop(view: str, number: int) -> Row:
    """Return the delays of commands in one of several rounds."""
    robot = robot_called(ROBOT)
    with tempfile.TemporaryDirectory() as place, standing_go2():
        folder = RunFolder.create(Path(place, "run"), robot, BayesianMethod(), {})
        with folder, viewed(view, folder.path):
            remote = RemoteRobot("unitree-go2", robot, GO2, folder.log)
            with remote:
                oscillate(remote, SECONDS)
            report = remote.report()
    names = ("commands", "overruns", "stalls", "late_999", "latest", "realtime")
    return {name: getattr(report, name) for name in names} | {"load": os.getloadavg()[0]}


def show(rows: list[Row]) -> Iterator[str]:
    yield "## Effect of the view on the control loop"
    yield ""
    yield (
        "An emulator sends a Go2's messages over DDS on loopback in its own process; the guarded loop oscillates it at 500 "
        f"Hz and writes its log. Rounds of {SECONDS:g} s, in turn; delay of commands after their deadlines, all rounds. The "
        "view is a separate process that reads the log at a lower priority (nice 10), without work for the loop. The "
        "remaining effect is competition for cores: emulator, loop, view and a browser without a graphics card share one "
        f"machine here. Real-time priority: {', '.join(sorted({row['realtime'] for row in rows}))}."
    )
    yield ""
    head = (
        "",
        "rounds",
        "within 1 ms",
        "99.9 % [ms]",
        "latest [ms]",
        "deadlines without command",
        "load of the machine",
    )
    yield from markdown(head, _lines(rows))


def _lines(rows: list[Row]) -> Iterator[list[str]]:
    for view in VIEWS:
        if of := [row for row in rows if row["case"][0] == view]:
            late = column(of, "overruns").sum() / column(of, "commands").sum()
            delays = [figures(1e3 * column(of, name).max(), ".2f") for name in ("late_999", "latest")]
            stalls = f"{column(of, 'stalls').sum():.0f}"
            yield [view, str(len(of)), f"{1 - late:.3%}", *delays, stalls, f"{column(of, 'load').max():.1f}"]


TABLES = (Table("view", loop, [(view, number) for number in range(ROUNDS) for view in VIEWS], show, alone=True),)
