"""Table of methods: built-in ones, and those of other packages with an entry point in the group `equipoise.methods`.

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
    """Return the class of a method's settings, which for built-in methods does not import an estimator.

    Raises:
        SettingsError: the name is unknown or ambiguous.
        MissingDependencyError: the package of the method cannot be imported, or does not define a method.
    """
    return resolve(_SETTINGS[name]) if name in _SETTINGS else method_named(name)


def method_named(name: str) -> type[Method]:
    """Return the class of a method.

    Raises:
        SettingsError: the name is unknown or ambiguous.
        MissingDependencyError: the package of the method cannot be imported, or does not define a method.
    """
    kind = METHODS[name]
    if not issubclass(kind, Method):
        raise MissingDependencyError(
            f"method {name!r} cannot be used: {kind.__name__} is not a subclass of equipoise.Method"
        )
    own_name = getattr(kind, "name", None)
    if own_name != name or kind.__abstractmethods__:
        lacks = ", ".join(sorted(kind.__abstractmethods__)) or f"the name {name!r}; its name is {own_name!r}"
        raise MissingDependencyError(f"method {name!r} cannot be used: {kind.__name__} lacks {lacks}")
    return kind


def method_from_dict(table: Mapping[str, Any]) -> Method:
    """Return a method from `Method.to_dict`; raises SettingsError and MissingDependencyError."""
    from equipoise.method.combined import AND_MOTORS, CombinedMethod  # noqa: PLC0415 - flags need no robot model

    own = {name: value for name, value in table.items() if name != AND_MOTORS}
    method = method_named(str(own.get("method"))).from_dict(own)
    return method if AND_MOTORS not in table else CombinedMethod(method, method_from_dict(table[AND_MOTORS]))
