"""Tables of built-in rows and rows of other packages, added by entry points such as this one in their `pyproject.toml`.

    [project.entry-points."equipoise.platforms"]
    my-robot = "my_package.robot:DRIVER"

An entry point is loaded when its name is used; listing names does not load any.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Iterator, Mapping
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Generic, TypeVar, cast

from equipoise.errors import EquipoiseError, MissingDependencyError, SettingsError, did_you_mean

Row = TypeVar("Row")


class Table(Generic[Row]):
    """Rows by name: built-in ones, and those of installed packages.

    Args:
        noun: word for a row in messages, as "platform".
        group: name of the entry point group.
        kind: class of a row, or a protocol that can be checked at run time.
        own: built-in rows; a text is the path of one, as "equipoise.bayesian.method:BAYESIAN", and is imported on first
            use.
    """

    def __init__(
        self, noun: str, group: str, kind: type[Row] | tuple[type[Any], ...], own: Mapping[str, Row | str]
    ) -> None:
        self._noun, self._group, self._kind, self._own = noun, group, kind, own

    def __iter__(self) -> Iterator[str]:
        return iter(dict.fromkeys((*self._own, *sorted(self._added))))

    def __contains__(self, name: object) -> bool:
        return name in self._own or name in self._added

    def __getitem__(self, name: str) -> Row:
        """Return the row of a name.

        Raises:
            SettingsError: no row has the name, or two have.
            MissingDependencyError: the package that adds it cannot be imported, or adds an object of another type.
        """
        added = self._added.get(name, [])
        if len(added) + (name in self._own) > 1:
            owners = [*(["equipoise"] if name in self._own else []), *map(distribution, added)]
            raise SettingsError(
                f"{self._noun} {name!r} is defined twice, by {' and '.join(owners)}; uninstall or rename one"
            )
        if added:
            return self._loaded(name, added[0])
        if name not in self._own:
            raise SettingsError(f"{self._noun} {name!r} is unknown; it must be one of {', '.join(self)}")
        row = self._own[name]
        return resolve(row) if isinstance(row, str) else cast("Row", row)

    def rows(self) -> dict[str, Row | EquipoiseError]:
        """Return all rows by name, or the error of a row that cannot be used."""
        found: dict[str, Row | EquipoiseError] = {}
        for name in self:
            try:
                found[name] = self[name]
            except EquipoiseError as error:
                found[name] = error
        return found

    @cached_property
    def _added(self) -> Mapping[str, list[EntryPoint]]:
        added: dict[str, list[EntryPoint]] = {}
        for entry in entry_points(group=self._group):
            added.setdefault(entry.name, []).append(entry)
        return added

    def _loaded(self, name: str, entry: EntryPoint) -> Row:
        whose = f"{self._noun} {name!r} of the package {distribution(entry)}"
        try:
            row = entry.load()
        except (Exception, SystemExit) as error:  # another package's module may raise anything on import
            raise MissingDependencyError(
                f"{whose} cannot be used: {entry.value!r} fails ({type(error).__name__}: {error}); "
                "install another version of it, or uninstall it"
            ) from error
        if not isinstance(row, self._kind):
            kinds = self._kind if isinstance(self._kind, tuple) else (self._kind,)
            raise MissingDependencyError(
                f"{whose} cannot be used: {entry.value!r} is of type {type(row).__name__}; "
                f"it must be {' or '.join(kind.__name__ for kind in kinds)}"
            )
        if not isinstance(row, type) and getattr(row, "name", name) != name:
            raise MissingDependencyError(
                f"{whose} cannot be used: its own name is {row.name!r}; both names must be the same"
            )
        return cast("Row", row)


def distribution(entry: EntryPoint) -> str:
    """Return the name and version of the package that adds an entry point."""
    return "?" if entry.dist is None else f"{entry.dist.name} {entry.dist.version}"


def resolve(path: str) -> Any:
    """Return the object that "module:name" names."""
    module, _, name = path.partition(":")
    return getattr(importlib.import_module(module), name)


def import_users(noun: str, path: str) -> Any:
    """Return the object that a user names as MODULE:NAME; the module may be in the current folder.

    Args:
        noun: word for it in messages, as "platform".
        path: module and name, as "my_robot:MyRobot".

    Raises:
        SettingsError: the module or the name in it does not exist.
        MissingDependencyError: the module fails when it is imported.
    """
    name, _, attribute = path.partition(":")
    here = os.getcwd()
    if here not in sys.path and "" not in sys.path:
        sys.path.insert(0, here)
    try:
        module = importlib.import_module(name)
    except (Exception, SystemExit) as error:  # another package's module may raise anything on import
        if isinstance(error, ModuleNotFoundError) and error.name and f"{name}.".startswith(f"{error.name}."):
            raise SettingsError(
                f"{noun} {path!r}: module {error.name!r} does not exist, neither in {here!r} nor among the installed packages"
            ) from error
        raise MissingDependencyError(
            f"{noun} {path!r}: the module {name!r} fails when it is imported ({type(error).__name__}: {error})"
        ) from error
    if hasattr(module, attribute):
        return getattr(module, attribute)
    classes = [key for key, value in vars(module).items() if isinstance(value, type) and value.__module__ == name]
    near = did_you_mean(attribute, classes)
    raise SettingsError(
        f"{noun} {path!r}: the module {name!r} has no {attribute!r}; {near}its classes are {', '.join(classes) or 'none'}"
    )
