"""A viewer in a process of its own: the one that moves the robot starts it, and never waits for it afterwards.

It follows the log that the run writes anyway. It ends when the run's process ends, however that comes about, for then its
standard input is closed; if it dies itself, nobody but the person who looks at it notices.
"""

from __future__ import annotations

import getpass
import json
import os
import select
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

from equipoise import errors
from equipoise.errors import EquipoiseError, OutputError
from equipoise.threads import ONE_THREAD
from equipoise.view.open import Viewing, be_gentle, open_run
from equipoise.view.player import Player
from equipoise.view.viser_page import Page, require_port, require_viser, show

HOST, PORT = "127.0.0.1", 8080
_STARTING = 60.0  # [s]: on a busy computer imports alone take ten


class ViewerProcess:
    """A page that follows a run. Use it as a context manager, or close it.

    Args:
        path: the run folder.
        host, port: where the page is served.

    Attributes:
        url: of the page.

    Raises:
        MissingDependencyError: viser is not installed.
        SettingsError: the port is in use.
        OutputError: the process does not start.
    """

    def __init__(self, path: Path, host: str = HOST, port: int = PORT) -> None:
        require_viser()
        require_port(host, port)
        command = [sys.executable, "-m", "equipoise.view.process", str(path), host, str(port)]
        # In a session of its own: Ctrl-C is for the run, which ends the page in its own time.
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
            env={**os.environ, **ONE_THREAD},
        )
        try:
            self.url = self._greeting()
        except BaseException:
            self.close()
            raise

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid

    def close(self) -> None:
        """End the page. May be called twice."""
        if self._process.poll() is None:
            self._process.terminate()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()
        try:
            self._process.wait(timeout=2.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def __enter__(self) -> ViewerProcess:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _greeting(self) -> str:
        """Its address, or the error that it tells."""
        stdout = self._process.stdout
        assert stdout is not None
        ready, _, _ = select.select([stdout], [], [], _STARTING)
        said = stdout.readline() if ready else ""
        table: dict[str, str] = json.loads(said) if said else {}
        if "url" in table:
            return table["url"]
        if "error" in table:
            raise getattr(errors, table["error"])(table["message"])
        raise OutputError("the view did not start; run without --view, and look at the run afterwards: equipoise view")


def how_to_look(url: str) -> str:
    """What a person has to know who is not at the computer that serves a page."""
    port, me = url.rsplit(":", 1)[-1], f"{getpass.getuser()}@{socket.gethostname()}"
    return (
        f"view: {url}\n      from another computer: ssh -L {port}:127.0.0.1:{port} {me}, then open "
        f"http://127.0.0.1:{port} there"
    )


def serve(viewing: Viewing, title: str, host: str, port: int, live: bool, greet: Callable[[str], None]) -> None:
    """Serve a page for ever.

    Args:
        live: whether it keeps up with what is written.
        greet: told the page's address once it can be opened.
    """
    player = Player(live)
    viewing.refresh()
    with Page(title, viewing.camera, player, host, port) as page:
        greet(f"http://{host}:{page.port}")
        show(page, player, viewing.refresh)


def main(path: str, host: str, port: str) -> None:
    """Follow a run until the process that started this one ends."""
    be_gentle()
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        showing = open_run(Path(path))
        with Viewing(showing) as viewing:
            serve(viewing, showing.title, host, int(port), True, lambda url: _say({"url": url}))
    except EquipoiseError as error:
        _say({"error": type(error).__name__, "message": str(error)})


def _say(table: dict[str, str]) -> None:
    print(json.dumps(table), flush=True)


def _end_with_parent() -> None:
    sys.stdin.read()
    os._exit(0)


if __name__ == "__main__":
    main(*sys.argv[1:])
