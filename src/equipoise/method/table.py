"""Methods by name: ours, and those that other packages add with an entry point in the group `equipoise.methods`.

[project.entry-points."equipoise.methods"]
wiggle = "my_package.wiggle:Wiggle"
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from equipoise.errors import MissingDependencyError
from equipoise.method.method import Method
from equipoise.plugins import Table, resolve

METHODS: Table[type[Any]] = Table(
    "method",
    "equipoise.methods",
    type,
    {
        "bayesian": "equipoise.bayesian.method:BayesianMethod",
        "paper": "equipoise.paper.method:PaperMethod",
        "motors": "equipoise.motors.method:Motors",
    },
)


_SETTINGS = {
    "bayesian": "equipoise.bayesian.settings:BayesianSettings",
    "paper": "equipoise.paper.settings:PaperSettings",
    "motors": "equipoise.motors.settings:MotorsSettings",
}


def settings_of(name: str) -> type[Any]:
    """Return the class of a method's settings, from which flags are read: without an estimator where it is one of ours.

    Raises:
        SettingsError: there is no such method, or two.
        MissingDependencyError: the package that brings it cannot be imported, or brings something else.
    """
    return resolve(_SETTINGS[name]) if name in _SETTINGS else method_named(name)


def method_named(name: str) -> type[Method]:
    """The method of a name.

    Raises:
        SettingsError: there is none, or two.
        MissingDependencyError: the package that brings it cannot be imported, or brings something else.
    """
    kind = METHODS[name]
    if not issubclass(kind, Method):
        raise MissingDependencyError(
            f"method {name!r} cannot be used: {kind.__name__} is no subclass of equipoise.Method"
        )
    said = getattr(kind, "name", None)
    if said != name or kind.__abstractmethods__:
        lacks = ", ".join(sorted(kind.__abstractmethods__)) or f"the name {name!r}; it says {said!r}"
        raise MissingDependencyError(f"method {name!r} cannot be used: {kind.__name__} lacks {lacks}")
    return kind


def method_from_dict(table: Mapping[str, Any]) -> Method:
    """A method with its settings, from `Method.to_dict`; raises SettingsError and MissingDependencyError."""
    from equipoise.method.combined import AND_MOTORS, CombinedMethod  # noqa: PLC0415 - flags need no robot model

    own = {name: value for name, value in table.items() if name != AND_MOTORS}
    method = method_named(str(own.get("method"))).from_dict(own)
    return method if AND_MOTORS not in table else CombinedMethod(method, method_from_dict(table[AND_MOTORS]))
