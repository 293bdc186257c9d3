"""Conversion of exceptions of other packages into equipoise errors."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from equipoise.errors import CommunicationError, EquipoiseError, MotionError

Returned = TypeVar("Returned")


def translated(name: str, method: str, act: Callable[[], Returned]) -> Returned:
    """Call a method of a platform or of a driver's connection, and return its result.

    Args:
        name: name of the platform.
        method: name of the method.
        act: function that calls it.

    Raises:
        EquipoiseError: as raised by the method.
        CommunicationError: the method raised an OSError.
        MotionError: the method raised another exception.
    """
    try:
        return act()
    except EquipoiseError:
        raise
    except OSError as error:
        raise CommunicationError(f"platform {name!r} cannot be reached: {method} fails ({error})") from error
    except Exception as error:
        raise MotionError(f"platform {name!r}: {method} fails ({type(error).__name__}: {error})") from error
