"""`equipoise`, and `python -m equipoise`."""

import os
import sys

from equipoise.cli import main  # which imports nothing that imports NumPy
from equipoise.threads import unless_told


def run() -> int:
    """What the command does: its own process is the only one whose environment is ours to set, before NumPy reads it."""
    os.environ.update(unless_told(os.environ))
    return main()


if __name__ == "__main__":
    sys.exit(run())
