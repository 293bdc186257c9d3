"""Code of other packages: whatever it raises becomes an error of ours."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from equipoise.errors import CommunicationError, EquipoiseError, MotionError

Returned = TypeVar("Returned")


def translated(name: str, what: str, act: Callable[[], Returned]) -> Returned:
    """Call a method of a platform or of a driver's connection, and return its result.

    Args:
        name: name of the platform.
        what: name of the method.
        act: what calls it.

    Raises:
        EquipoiseError: as it was raised.
        CommunicationError: it raised an OSError.
        MotionError: it raised something else.
    """
    try:
        return act()
    except EquipoiseError:
        raise
    except OSError as error:
        raise CommunicationError(f"platform {name!r} cannot be reached: {what} fails ({error})") from error
    except Exception as error:
        raise MotionError(f"platform {name!r}: {what} fails ({type(error).__name__}: {error})") from error
