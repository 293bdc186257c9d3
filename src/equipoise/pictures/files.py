"""Pictures as files.

Only Matplotlib's objects are used, never pyplot, so that drawing changes nothing in the user's own session.
"""

# pyright: reportUnknownMemberType=false
# Matplotlib's own stubs leave **kwargs without a type, which makes every method that takes them partially unknown.

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path

from matplotlib.figure import Figure

from equipoise.errors import OutputError
from equipoise.pictures.figure import DPI
from equipoise.pictures.plan_view import draw_plan_view
from equipoise.result.calibration import Calibration
from equipoise.user_file import write_file


def save_plan_view(calibration: Calibration, folder: str | Path) -> list[Path]:
    """Write plan_view.png, unless the CoM is not known in the plane; the folder is made if need be.

    Raises:
        OutputError: it cannot be written.
    """
    figure = draw_plan_view(calibration)
    return save_figures({} if figure is None else {"plan_view.png": figure}, folder)


def save_figures(figures: Mapping[str, Figure], folder: str | Path) -> list[Path]:
    """Write figures as PNG files by name; the folder is made if need be. Raises OutputError if that fails."""
    paths = [Path(folder) / name for name in figures]
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot write the pictures to {str(folder)!r}: {error.strerror or error}") from error
    for path, figure in zip(paths, figures.values(), strict=True):
        write_file(path, _png(figure), "the picture ")
    return paths


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI)
    return buffer.getvalue()
