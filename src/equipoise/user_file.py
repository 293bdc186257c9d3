"""Files named by the user: recognition, reading and atomic writing of regular files."""

from __future__ import annotations

import errno
import json
import os
import re
import secrets
import shlex
import stat
import sys
from pathlib import Path
from typing import Any

from equipoise.errors import OutputError, RecordingError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
)
_LFS_POINTER = b"version https://git-lfs.github.com/spec/"
_IS_LFS_POINTER = "a Git LFS pointer: run `git lfs pull` in its repository"
_HEAD = 65536  # bytes that are read to recognise a file
_PROLOGUE = rb"(?:\xef\xbb\xbf)?(?:\s|<\?.*?\?>|<!--.*?-->|<![^>]*>)*"
_CONTENTS = (
    (rb"$", "an empty file"),
    (rb"\x89MCAP", "an MCAP recording"),
    (_LFS_POINTER, _IS_LFS_POINTER),
    (_PROLOGUE + rb"<robot\b[^>]*xmlns:xacro", "a xacro file"),
    (_PROLOGUE + rb"<robot\b", "a URDF robot model"),
    (_PROLOGUE + rb"<mujoco\b", "an MJCF robot model"),
    (_PROLOGUE + rb"<sdf\b", "an SDF model"),
    (_PROLOGUE + rb"<", "an XML file"),
    (rb'\s*\{\s*"schema": "equipoise\.calibration/', "the result of a calibration"),
    (rb"\s*[\[{]", "a JSON file"),
    (rb".*\x00", "a binary file"),
)


class UnreadableError(OSError):
    """Path that is not a readable regular file; callers put the reason into their own error."""

    def __str__(self) -> str:
        return self.strerror or ""


def _irregular_kind(mode: int) -> str | None:
    """Return the kind of a path of this mode, in words; None for a regular file."""
    return next((kind for is_kind, kind in _KINDS if is_kind(mode)), None)


def refuse_unreadable(path: str | Path) -> None:
    """Refuse a path at which a reader would block or misread: a pipe, a device, a socket, a Git LFS pointer.

    Raises:
        UnreadableError: the path leads to one of these.
        OSError: the file does not exist, or may not be read. The caller handles folders.
    """
    mode = os.stat(path).st_mode
    if stat.S_ISDIR(mode):
        return
    if kind := _irregular_kind(mode):
        raise UnreadableError(errno.EINVAL, f"it is {kind}; save its content as a regular file, and name that file")
    with open(path, "rb") as file:
        if file.read(len(_LFS_POINTER)) == _LFS_POINTER:
            raise UnreadableError(errno.EINVAL, f"it is {_IS_LFS_POINTER}")


def read_bytes(path: str | Path) -> bytes:
    """Return the content of a regular file; raises OSError, as `refuse_unreadable` does."""
    refuse_unreadable(path)
    return Path(path).read_bytes()


def read_text(path: str | Path) -> str:
    """Return the text of a regular file in UTF-8; raises OSError, as `refuse_unreadable` does, and UnicodeDecodeError."""
    return read_bytes(path).decode()


def toml_table(text: str) -> dict[str, Any]:
    """Return the table of a TOML text; raises ValueError."""
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def json_value(text: str) -> Any:
    """Return the value of a JSON text; raises ValueError."""
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def check_schema(found: object, expected: str, what: str) -> None:
    """Refuse a file of another schema; raises RecordingError.

    Args:
        found: schema in the file.
        expected: schema that this version writes and reads.
        what: name of the file in the message, as in "the result 'calibration.json'".
    """
    if found != expected:
        kind, _, _ = expected.partition("/")
        ours = str(found).startswith(f"{kind}/")
        remedy = "it was made by an earlier version; record or estimate again" if ours else "it is another kind of file"
        raise RecordingError(
            f"{what} is {found!r}; this version reads {expected!r}: {remedy}",
            details={"found": found, "expected": expected},
        )


def partial_path(path: Path) -> Path:
    """Return a new path in a file's folder, for its content until that is complete."""
    return path.with_name(f".{path.name}.{secrets.token_hex(4)}.partial")


def remove_partial_files(folder: Path) -> None:
    """Remove files in a folder that a killed process was writing."""
    for partial in folder.glob(".*.partial"):
        partial.unlink()


def write_file(path: Path, content: str | bytes, what: str = "") -> None:
    """Write or replace a file; it appears under its name only when it is complete.

    The target of a symbolic link is replaced, not the link. A link without a target is refused.

    Args:
        content: content of the file; text is written as UTF-8.
        what: name of the file in messages, as in "the report ".

    Raises:
        OutputError: the path is not a regular file, as a device or a pipe, or cannot be written.
    """
    data = content.encode() if isinstance(content, str) else content
    try:
        mode = replaceable(path, what)
        target = Path(os.path.realpath(path))
        partial = partial_path(target)
        try:
            with open(partial, "xb") as file:
                file.write(data)
            if mode is not None:
                partial.chmod(mode)
            partial.replace(target)
        except BaseException:
            partial.unlink(missing_ok=True)
            raise
    except OutputError:
        raise
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise OutputError(
            f"cannot write {what}{str(path)!r}: {reason}; check that the folder exists, is writable and has free space"
        ) from error


def kind_of(path: str | Path) -> str:
    """Return the kind of a path, as "is a URDF robot model" or "does not exist"; reads regular files only."""
    path = Path(path)
    try:
        mode = path.stat().st_mode
        if kind := _irregular_kind(mode):
            return f"is {kind}"
        with open(path, "rb") as file:
            head = file.read(_HEAD)
    except (FileNotFoundError, NotADirectoryError):
        return "does not exist"
    except (OSError, ValueError) as error:
        return f"cannot be read ({error.strerror if isinstance(error, OSError) else error})"
    for pattern, kind in _CONTENTS:
        if re.match(pattern, head, re.DOTALL):
            return f"is {kind}"
    return f"is a {path.suffix or 'text'} file"


def typed(path: str | Path) -> str:
    """Return a path for a command to copy, quoted for a shell if necessary."""
    return shlex.quote(str(path))


def made_folder(folder: Path) -> Path:
    """Return a folder, created if necessary, but not its parents: the path may be mistyped. Raises OutputError."""
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"cannot write into {str(folder)!r}: {error.strerror}; check that its parent folder exists and is writable"
        ) from error
    return folder


def replaceable(path: Path, what: str = "") -> int | None:
    """Return the permissions of the regular file at a path, links followed; None if it does not exist.

    Raises:
        OutputError: the path is not a regular file.
    """
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        if path.is_symlink():
            raise OutputError(
                f"cannot write {what}{str(path)!r}: it is a link to {os.readlink(path)!r}, which does not exist; remove it, "
                "or name another file"
            ) from None
        return None
    if kind := _irregular_kind(mode):
        raise OutputError(
            f"cannot write {what}{str(path)!r}: it is {kind}, which is never replaced; name a regular file, or a new one"
        )
    return stat.S_IMODE(mode)
