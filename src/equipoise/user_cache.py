"""Cache of computed files in the user's folder, which may be emptied at any time.

The folder is `EQUIPOISE_CACHE`, or `equipoise` in the system's cache folder. If the variable is empty, or the folder cannot
be written, nothing is cached.
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path

from equipoise.errors import OutputError
from equipoise.user_file import write_file

VARIABLE = "EQUIPOISE_CACHE"
_MOST = 32  # files; the oldest go first


def read_cached(name: str) -> bytes | None:
    """Return the content of a cached file; None if it does not exist."""
    folder = _folder()
    if folder is None:
        return None
    try:
        return (folder / name).read_bytes()
    except OSError:
        return None


def keep_cached(name: str, content: bytes) -> None:
    """Cache a file, and remove the oldest of many; a file that cannot be written is not an error."""
    folder = _folder()
    if folder is None:
        return
    with suppress(OSError, OutputError):
        folder.mkdir(parents=True, exist_ok=True)
        write_file(folder / name, content)
        by_age = sorted(folder.iterdir(), key=lambda path: path.stat().st_mtime, reverse=True)
        for path in by_age[_MOST:]:
            path.unlink(missing_ok=True)


def _folder() -> Path | None:
    folder = os.environ.get(VARIABLE)
    if folder is not None:
        return Path(folder) if folder else None
    with suppress(RuntimeError):  # no home folder
        return _of_system() / "equipoise"
    return None


def _of_system() -> Path:
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
