"""Files that a user names: what they are; only regular files are read or replaced; written whole or not at all."""

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
    """Path that leads to something else than a readable regular file; callers put the reason into an error of theirs."""

    def __str__(self) -> str:
        return self.strerror or ""


def _irregular_kind(mode: int) -> str | None:
    """Return what a path of this mode is, in words; None for a regular file."""
    return next((kind for is_kind, kind in _KINDS if is_kind(mode)), None)


def refuse_unreadable(path: str | Path) -> None:
    """Refuse a path at which a reader would block or misread: a pipe, a device, a socket, a Git LFS pointer.

    Raises:
        UnreadableError: the path leads to one of these.
        OSError: there is no file, or no permission to read it. A folder is left to the caller.
    """
    mode = os.stat(path).st_mode
    if stat.S_ISDIR(mode):
        return
    if kind := _irregular_kind(mode):
        raise UnreadableError(errno.EINVAL, f"it is {kind}; save its content as a regular file, and give that")
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


def write_file(path: Path, content: str | bytes, what: str = "") -> None:
    """Write a file, in place of one that is there; it appears under its name only when it is complete.

    A symbolic link is never replaced: the regular file that it leads to is. One that leads nowhere is refused.

    Args:
        content: content of the file; text is written as UTF-8.
        what: name of the file in messages, as in "the report ".

    Raises:
        OutputError: there is something else than a regular file, as a device or a pipe, or it cannot be written.
    """
    data = content.encode() if isinstance(content, str) else content
    try:
        mode = replaceable(path, what)
        target = Path(os.path.realpath(path))
        partial = target.with_name(f".{target.name}.{secrets.token_hex(4)}.partial")
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
            f"cannot write {what}{str(path)!r}: {reason}; is there such a folder, may you write there, is there room?"
        ) from error


def kind_of(path: str | Path) -> str:
    """Return what a path is, as in "is a URDF robot model" or "does not exist"; regular files alone are read."""
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
    """A path in a command that is offered for copying: quoted where a shell would take it apart."""
    return shlex.quote(str(path))


def made_folder(folder: Path) -> Path:
    """A folder that is there now. What should hold it is not made: its path may be mistyped. Raises OutputError."""
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"cannot write into {str(folder)!r}: {error.strerror}; is the folder there that holds it, may you write there?"
        ) from error
    return folder


def replaceable(path: Path, what: str = "") -> int | None:
    """Permissions of the regular file at a path, links followed; None if there is nothing.

    Raises:
        OutputError: there is something else.
    """
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        if path.is_symlink():
            raise OutputError(
                f"cannot write {what}{str(path)!r}: it is a link to {os.readlink(path)!r}, where nothing is; remove it, or "
                "name another file"
            ) from None
        return None
    if kind := _irregular_kind(mode):
        raise OutputError(
            f"cannot write {what}{str(path)!r}: it is {kind}, which no result replaces; name a regular file, or a new one"
        )
    return stat.S_IMODE(mode)
