"""Header of a run folder, run.json. Reading it does not import NumPy or a robot model."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

from equipoise.errors import RecordingError
from equipoise.user_file import check_schema, json_value, kind_of, read_text

SCHEMA = "equipoise.run/1"
HEADER = "run.json"
RESULT = "calibration.json"
REMEDY = "copy it again from an intact run folder"
NEEDED = "name the run folder of a calibration"


def read_header(path: Path, needed: str = NEEDED) -> dict[str, Any]:
    """Return the header of a run folder; raises RecordingError, with what is needed, if it is not one."""
    if path.is_file() and (path.parent / HEADER).is_file():
        raise RecordingError(f"{str(path)!r} is a file in a run folder; give the folder, {str(path.parent)!r}")
    if not (path / HEADER).exists():
        without = f" without {HEADER}" if path.is_dir() else ""
        raise RecordingError(f"{str(path)!r} {kind_of(path)}{without}; {needed}")
    header = read_json(path / HEADER, f"{str(path)!r} is not a run folder of a calibration")
    if (schema := header.get("schema")) is None:
        raise damaged(path, f"its {HEADER} lacks 'schema'")
    check_schema(schema, SCHEMA, f"the run {str(path)!r}")
    for key in ("model", "description", "settings", "provenance"):
        if not isinstance(header.get(key), dict):
            raise damaged(path, f"its {HEADER} lacks {key!r}")
    return header


def damaged(path: Path, defect: str) -> RecordingError:
    """Return the error about a damaged run folder."""
    return RecordingError(f"the run {str(path)!r} is damaged: {defect}; {REMEDY}")


def read_json(path: Path, otherwise: str, remedy: str = "") -> dict[str, Any]:
    """Return the JSON object in a file of a run.

    Args:
        otherwise: beginning of the error message.
        remedy: end of the error message.

    Raises:
        RecordingError: the file cannot be read, or is not a JSON object.
    """
    try:
        table = json_value(read_text(path))
    except OSError as error:
        raise RecordingError(f"{otherwise}: {str(path)!r} cannot be read ({error.strerror}){remedy}") from error
    except ValueError as error:
        raise RecordingError(f"{otherwise}: {str(path)!r} is not JSON ({error}){remedy}") from error
    if not isinstance(table, dict):
        raise RecordingError(f"{otherwise}: {str(path)!r} is not a JSON object{remedy}")
    return cast("dict[str, Any]", table)
