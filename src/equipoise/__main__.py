"""`equipoise`, and `python -m equipoise`."""

import os
import signal
import sys
from typing import Any

from equipoise.cli import INTERRUPTED, main  # which imports nothing that imports NumPy
from equipoise.threads import unless_told


def run() -> int:
    """Run the command. Its own process is the only one whose environment is ours to set, before NumPy reads it."""
    os.environ.update(unless_told(os.environ))
    stdout: Any = sys.stdout
    if getattr(stdout, "errors", None) == "strict":  # it may have no letters for a robot's name, or a file's
        stdout.reconfigure(errors="backslashreplace")
    try:
        code = main()
    except KeyboardInterrupt:  # a second one, while the first was told of
        code = INTERRUPTED
    if code == INTERRUPTED:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # all that is left is to end
    return code


if __name__ == "__main__":
    sys.exit(run())
