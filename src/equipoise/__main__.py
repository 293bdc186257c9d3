"""Entry point of `equipoise` and `python -m equipoise`."""

import os
import signal
import sys
from typing import Any

from equipoise.cli import INTERRUPTED, main  # does not import NumPy
from equipoise.threads import default_threads


def run() -> int:
    """Run the command; sets environment variables of its process before NumPy reads them."""
    os.environ.update(default_threads(os.environ))
    stdout: Any = sys.stdout
    if getattr(stdout, "errors", None) == "strict":  # its encoding may lack letters of a robot's or a file's name
        stdout.reconfigure(errors="backslashreplace")
    try:
        code = main()
    except KeyboardInterrupt:  # a second one, while the first was being reported
        code = INTERRUPTED
    if code == INTERRUPTED:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # only the exit is left
    return code


if __name__ == "__main__":
    sys.exit(run())
