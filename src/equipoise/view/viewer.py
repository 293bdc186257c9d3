"""Display in Rerun's viewer: a window, a browser page or a file; live display runs in a separate process.

The run starts that process and otherwise ignores it. The process reads the run's log. Its standard input closes when the
run's process ends for any reason. The display process then shows the remaining data and ends.
"""

from __future__ import annotations

import getpass
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from equipoise.calibration.run_folder import RunFolder
from equipoise.errors import EquipoiseError, MissingDependencyError, OutputError, RecordingError
from equipoise.method.method import Method
from equipoise.recording.recording import Recording
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance
from equipoise.threads import ONE_THREAD
from equipoise.view.convergence import estimates
from equipoise.view.follow import News, follow
from equipoise.view.rerun_scene import Scene, blueprint

WINDOW, BROWSER = "window", "browser"
_HOST = "127.0.0.1"
_PAGE_PORT, _DATA_PORT = 9090, 9876  # defaults of Rerun; replaced by free ports if in use
_RERUN = "import sys; from rerun_cli.__main__ import main; sys.exit(main())"  # passes on the exit code
_POLL, _FLUSH = 0.1, 10.0  # [s] poll interval of a log; limit for flushing the last data


def require_rerun() -> Any:
    """Return the package `rerun`; raise MissingDependencyError if it is not installed."""
    os.environ.setdefault("RUST_LOG", "off")  # otherwise Rerun reports every closed window
    try:
        import rerun  # noqa: PLC0415 - optional
    except ModuleNotFoundError as error:
        raise MissingDependencyError("the view needs rerun-sdk: pip install 'equipoise[view]'") from error
    return rerun


def has_display() -> bool:
    """Return True if a window can be opened."""
    return sys.platform in ("darwin", "win32") or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


def free_port(preferred: int) -> int:
    """Return a free port of this computer, the preferred one if possible."""
    for port in (preferred, 0):
        with suppress(OSError), socket.create_server((_HOST, port)) as server:
            return int(server.getsockname()[1])
    raise OutputError(f"no port of {_HOST} is free; write a file with --out")


def view(
    target: str,
    title: str,
    robot: RobotModel,
    method: Method,
    news: Iterable[News],
    greet: Callable[[str], None],
    over: threading.Event,
) -> None:
    """Show a run or a log.

    Args:
        target: WINDOW, which stays open afterwards; BROWSER, which is served until `over`; or the path of a file to write.
        title: name of the recording.
        news: new pieces of motion and new complete trials.
        greet: function that receives the file, the address of the page, or WINDOW; see `how_to_open`.
        over: event that ends the serving of a page.

    Raises:
        RecordingError: the log holds no samples.
        OutputError: the file cannot be written, or the viewer failed.
    """
    stream = require_rerun().RecordingStream("equipoise")
    stream.send_recording_name(title)
    if target not in (WINDOW, BROWSER):
        try:
            stream.save(target, default_blueprint=blueprint())
        except (OSError, RuntimeError) as error:
            raise OutputError(f"{target!r} cannot be written: {error}") from error
        greet(target)
        _show(stream, robot, method, news, lambda: True)
        return
    served = target == BROWSER
    with _viewer(served) as (process, address, page):
        stream.connect_grpc(address, default_blueprint=blueprint())
        greet(page if served else WINDOW)
        _show(stream, robot, method, news, lambda: process.poll() is None and not (served and over.is_set()))
        while served and process.poll() is None and not over.wait(_POLL):
            pass


@contextmanager
def _viewer(served: bool) -> Generator[tuple[subprocess.Popen[bytes], str, str]]:
    """Start Rerun's viewer; yield its process, the address for data, and the address of its page."""
    port, page = free_port(_DATA_PORT), free_port(_PAGE_PORT)
    address = f"rerun+http://{_HOST}:{port}/proxy"
    command = [sys.executable, "-c", _RERUN, "--bind", _HOST, "--port", str(port)]
    command += ["--serve-web", "--web-viewer-port", str(page)] if served else ["--expect-data-soon"]
    quiet = subprocess.DEVNULL
    process = subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet, start_new_session=True)
    try:
        yield process, address, f"http://{_HOST}:{page}/?url={address.replace('+', '%2B')}"
        if process.poll():
            raise OutputError(
                f"the Rerun viewer failed with exit code {process.returncode}; 'equipoise view RUN' shows the run again"
            )
    finally:
        if served:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def _show(stream: Any, robot: RobotModel, method: Method, news: Iterable[News], going: Callable[[], bool]) -> None:
    """Write pieces of motion, and the estimate after each complete trial, while `going` returns True."""
    stance, recordings = nominal_stance(robot), list[Recording]()
    scene = Scene(stream, robot, stance, method.expected_trials(stance))
    coming = estimates(robot, stance, method, recordings)
    with ThreadPoolExecutor(1) as thread:  # an estimate takes seconds, and the robot keeps moving
        pending = thread.submit(next, coming)
        for pieces, complete in news:
            scene.take(pieces, complete)
            recordings += complete
            if pending.done():
                scene.log_estimate(pending.result())
                pending = thread.submit(next, coming)
            if not going():
                return
            time.sleep(_POLL)
        scene.log_estimate(pending.result())
    while going() and (estimate := next(coming)) is not None:
        scene.log_estimate(estimate)
    if scene.steps == 0:
        raise RecordingError("there is nothing to show: the log has no samples of joints and IMU")
    try:
        stream.flush(timeout_sec=_FLUSH)
        stream.disconnect()
    except RuntimeError as error:
        if going():
            raise OutputError(f"the view is incomplete: {error}") from error


def how_to_open(place: str) -> str:
    """Return instructions to open a view, also from another computer."""
    if not place.startswith("http:"):
        return f"view: in a Rerun {place}" if place == WINDOW else f"view: recorded in {place}"
    forwarded = " ".join(f"-L {port}:{_HOST}:{port}" for port in re.findall(f"{_HOST}:([0-9]+)", place))
    person = f"{getpass.getuser()}@{socket.gethostname()}"
    return f"view: {place}\n      from another computer: ssh {forwarded} {person}, then open the same address there"


@contextmanager
def live_viewer(folder: Path, target: str) -> Generator[subprocess.Popen[bytes]]:
    """Show a run folder while it is written.

    Args:
        target: WINDOW, BROWSER, or the path of a file, which is complete at the end.
    """
    command = [sys.executable, "-m", "equipoise.view.viewer", str(folder), target]
    environment = {**os.environ, **ONE_THREAD}
    # A new session, so that Ctrl-C reaches only the run.
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, env=environment, start_new_session=True
    )
    try:
        yield process
    finally:
        assert process.stdin is not None
        process.stdin.close()
        if target != WINDOW:
            with suppress(KeyboardInterrupt):
                process.wait()
            process.send_signal(signal.SIGINT)
            process.wait()


def main(path: str, target: str) -> None:
    """Show a run until the process that started this one ends."""
    with suppress(AttributeError, OSError):  # not supported on every system
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    os.nice(10)  # the process that moves the robot has priority
    over = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), over.set()), daemon=True).start()

    def greet(place: str) -> None:
        print(how_to_open(place), file=sys.stderr, flush=True)

    try:
        folder = RunFolder.open(Path(path))
        news = follow(folder.path, lambda: not over.is_set())
        view(target, folder.path.name, folder.robot(), folder.method(), news, greet, over)
    except (EquipoiseError, KeyboardInterrupt) as error:
        sys.exit(f"view: {str(error) or 'interrupted'}")


if __name__ == "__main__":
    main(*sys.argv[1:])
