"""Robots known by name, and where each model file comes from."""

from __future__ import annotations

import importlib
import importlib.util
from dataclasses import dataclass
from difflib import get_close_matches
from importlib import metadata, resources
from pathlib import Path
from typing import Literal

from equipoise.errors import MissingDependencyError, ModelError
from equipoise.robot.description import RobotDescription
from equipoise.robot.model import RobotModel

Package = Literal["equipoise", "example-robot-data", "pybullet"]
BUILT_IN_ROBOT = "unitree_a1"


@dataclass(frozen=True)
class CatalogEntry:
    """A robot known by name: the package its model file comes in, the path inside, and what to know about it."""

    name: str
    package: Package
    path: str
    note: str

    @property
    def hint(self) -> str:
        """How to get the package."""
        return {
            "equipoise": "built in",
            "example-robot-data": "pip install 'equipoise[robots]'",
            "pybullet": "pip install pybullet",
        }[self.package]

    def find(self) -> Path:
        """Path of the model file.

        Raises:
            MissingDependencyError: its package is not installed.
        """
        folder = _package_folder(self.package)
        path = None if folder is None else folder / self.path
        if path is None or not path.is_file():
            raise MissingDependencyError(
                f"robot {self.name!r} comes with the package {self.package}, which is not installed: {self.hint}; "
                f"{BUILT_IN_ROBOT!r} is built in"
            )
        return path


_ERD, _PYBULLET = "example-robot-data", "pybullet"
CATALOG: dict[str, CatalogEntry] = {
    entry.name: entry
    for entry in (
        CatalogEntry(BUILT_IN_ROBOT, "equipoise", "a1.urdf", "Unitree A1 of the paper"),
        CatalogEntry("a1", _ERD, "a1_description/urdf/a1.urdf", "Unitree A1, newer"),
        CatalogEntry("go1", _ERD, "go1_description/urdf/go1.urdf", "Unitree Go1"),
        CatalogEntry("go2", _ERD, "go2_description/urdf/go2.urdf", "Unitree Go2"),
        CatalogEntry("b1", _ERD, "b1_description/urdf/b1.urdf", "Unitree B1"),
        CatalogEntry("laikago", _ERD, "laikago_description/urdf/laikago.urdf", "Unitree Laikago"),
        CatalogEntry("anymal_b", _ERD, "anymal_b_simple_description/robots/anymal.urdf", "ANYmal B"),
        CatalogEntry("anymal_c", _ERD, "anymal_c_simple_description/urdf/anymal.urdf", "ANYmal C"),
        CatalogEntry("hyq", _ERD, "hyq_description/robots/hyq_no_sensors.urdf", "IIT HyQ"),
        CatalogEntry("solo8", _ERD, "solo_description/robots/solo.urdf", "ODRI Solo 8"),
        CatalogEntry("solo12", _ERD, "solo_description/robots/solo12.urdf", "ODRI Solo 12"),
        CatalogEntry("aliengo", _PYBULLET, "aliengo/aliengo.urdf", "Unitree Aliengo"),
        CatalogEntry("mini_cheetah", _PYBULLET, "mini_cheetah/mini_cheetah.urdf", "MIT Mini Cheetah"),
    )
}

_ROBOT_DESCRIPTIONS_PREFIX = "robot_descriptions:"


def load_robot(name_or_path: str | Path, description: RobotDescription | None = None) -> RobotModel:
    """A robot by its catalogue name, by the path of a URDF or MJCF file, or as `robot_descriptions:NAME`.

    Raises:
        ModelError: no such name or file, or the file is no quadruped.
        MissingDependencyError: the name is known and the package that holds it is not installed.
    """
    name_or_path = str(name_or_path)
    if name_or_path in CATALOG:
        return RobotModel.from_file(CATALOG[name_or_path].find(), name_or_path, description)
    if name_or_path.startswith(_ROBOT_DESCRIPTIONS_PREFIX):
        module = name_or_path.removeprefix(_ROBOT_DESCRIPTIONS_PREFIX)
        return RobotModel.from_file(_find_robot_description(module), module, description)
    if not Path(name_or_path).exists() and "/" not in name_or_path and "." not in name_or_path:
        raise ModelError(
            f"no robot is called {name_or_path!r} and no such file exists; {_meant(name_or_path)}known names are "
            f"{', '.join(CATALOG)}"
        )
    return RobotModel.from_file(name_or_path, None, description)


def _meant(name: str) -> str:
    """What somebody who mistyped a name may have meant."""
    near = get_close_matches(name.lower().replace("-", "_"), CATALOG, n=1)
    return f"did you mean {near[0]!r}? " if near else ""


def _package_folder(package: Package) -> Path | None:
    if package == "equipoise":
        return Path(str(resources.files("equipoise.robot") / "models"))
    if package == "pybullet":
        spec = importlib.util.find_spec("pybullet_data")
        return Path(spec.origin).parent if spec is not None and spec.origin is not None else None
    try:
        distribution = metadata.distribution("example-robot-data")
    except metadata.PackageNotFoundError:
        return None
    return Path(str(distribution.locate_file("cmeel.prefix/share/example-robot-data/robots")))


def _find_robot_description(name: str) -> Path:
    """Model file of the package robot_descriptions, which clones a repository when it is first asked for one."""
    name = name if name.endswith("_description") else f"{name}_description"
    try:
        module = importlib.import_module(f"robot_descriptions.{name}")
    except ModuleNotFoundError as error:
        if error.name == "robot_descriptions":
            raise MissingDependencyError(
                f"{_ROBOT_DESCRIPTIONS_PREFIX}{name} needs a package: pip install robot_descriptions"
            ) from error
        raise ModelError(f"robot_descriptions has no robot {name!r}: {error}") from error
    except Exception as error:  # a clone can fail in many ways, none of them typed
        raise ModelError(f"robot_descriptions could not fetch {name!r} (is there a network?): {error}") from error
    path = getattr(module, "URDF_PATH", None) or getattr(module, "MJCF_PATH", None)
    if path is None:
        raise ModelError(f"robot_descriptions gives no URDF or MJCF file for {name!r}")
    return Path(path)


@dataclass(frozen=True)
class CatalogRow:
    """A catalogue entry as it is on this machine. None: the package that holds it is not installed.

    Attributes:
        name: as `load_robot` takes it.
        mass: [kg].
        legs: and their joints, as in "4 x 3".
        leg_length: [m].
        source: the package.
        note: what to know about it.
        install: how to get it, if it is missing.
    """

    name: str
    mass: float | None
    legs: str | None
    leg_length: float | None
    source: str
    note: str
    install: str | None


def describe_catalog() -> list[CatalogRow]:
    """Every robot known by name, with what its model file says where it is installed."""
    rows: list[CatalogRow] = []
    for entry in CATALOG.values():
        try:
            robot = RobotModel.from_file(entry.find(), entry.name)
        except MissingDependencyError:
            rows.append(CatalogRow(entry.name, None, None, None, entry.package, entry.note, entry.hint))
            continue
        joints = len(robot.legs["FL"].joints)
        rows.append(
            CatalogRow(entry.name, robot.mass, f"4 x {joints}", robot.leg_length, entry.package, entry.note, None)
        )
    return rows
