"""The result in the files that controllers and simulators read."""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any


class _Room(ModuleType):
    """The room has the name of a public function: once it is imported, Python takes `equipoise.export` for the room."""

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        from equipoise.export.formats import export  # noqa: PLC0415 - formats import this room

        return export(*arguments, **named)


sys.modules[__name__].__class__ = _Room
