"""Names of the installed cyclonedds: robots run 0.10, newer Pythons have wheels of 11 only.

Unitree's uint8 are called `byte` here. The two are the same on the wire, but not in discovery. cyclonedds 11 announces a
uint8 as a kind of type that crashes 0.10, and a byte as the type that 0.10 announces for its uint8.
"""

from __future__ import annotations

import importlib.util
import sys
from importlib.metadata import version
from typing import Any

from equipoise.errors import MissingDependencyError

INSTALL = "'cyclonedds>=0.10.2,<0.11'" if sys.version_info < (3, 11) else "'cyclonedds>=11,<12'"
"""Requirement for which pip has a wheel, for this Python."""


def _why_not(error: Exception) -> str:
    """Return a message that names the failed package; a local folder cyclonedds may hide the installed one."""
    spec = importlib.util.find_spec("cyclonedds")
    if spec is None:
        return f"DDS needs cyclonedds: pip install {INSTALL}"
    [place, *_] = spec.submodule_search_locations or [str(spec.origin)]
    reason = f"{type(error).__name__}: {error}".splitlines()[0]
    return f"cyclonedds in {place} is broken or too old ({reason}): pip install --force-reinstall {INSTALL}"


try:
    from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
    from cyclonedds.core import DDSException, InstanceState, Listener, ReadCondition, SampleState, ViewState, WaitSet
    from cyclonedds.domain import Domain, DomainParticipant
    from cyclonedds.idl import make_idl_struct, types
    from cyclonedds.idl.types import array, sequence
    from cyclonedds.pub import DataWriter
    from cyclonedds.qos import Policy, Qos
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic
    from cyclonedds.util import duration

    VERSION = version("cyclonedds")
    _BYTE = types.byte if hasattr(types, "byte") else types.uint8  # pyright: ignore
    FIELD_TYPES: dict[str, Any] = {
        "bool": bool, "string": str, "uint8": _BYTE, "int8": _BYTE,
        **{name: getattr(types, name) for name in ("int16", "uint16", "int32", "uint32", "int64", "float32", "float64")},
    }  # fmt: skip
except Exception as error:  # an incomplete package raises ImportError, OSError, AttributeError or others
    raise MissingDependencyError(_why_not(error)) from error

__all__ = [
    "FIELD_TYPES", "INSTALL", "VERSION", "BuiltinDataReader", "BuiltinTopicDcpsPublication", "DDSException", "DataReader",
    "DataWriter", "Domain", "DomainParticipant", "InstanceState", "Listener", "Policy", "Qos", "ReadCondition",
    "SampleState", "Topic", "ViewState", "WaitSet", "array", "duration", "make_idl_struct", "sequence",
]  # fmt: skip
