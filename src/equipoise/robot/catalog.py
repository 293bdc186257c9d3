"""Catalogue of robots by name, with the source of each model file. Listing them reads no file."""

from __future__ import annotations

import importlib
import importlib.util
from dataclasses import dataclass
from importlib import metadata, resources
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from equipoise.errors import MissingDependencyError, ModelError, did_you_mean
from equipoise.user_file import read_bytes

if TYPE_CHECKING:
    from equipoise.robot.description import RobotDescription
    from equipoise.robot.model import RobotModel

Package = Literal["equipoise", "example-robot-data", "pybullet"]
BUILT_IN_ROBOT = "unitree_a1"


@dataclass(frozen=True)
class CatalogEntry:
    """Robot of the catalogue, with the main values of its model file, so that a list reads no file.

    Attributes:
        name: name that `load_robot` takes.
        source: package that has its model file.
        path: path of the file inside the package.
        mass: mass of the whole robot [kg], to a gram.
        legs: number of legs and of joints per leg, as in "4 x 3".
        leg_length: length of thigh and shank together [m], to a millimetre.
        note: remark for its user.
    """

    COMPUTED: ClassVar = ("install",)
    name: str
    source: Package
    path: str
    mass: float
    legs: str
    leg_length: float
    note: str

    @property
    def hint(self) -> str:
        """Command that installs the package."""
        return {
            "equipoise": "built in",
            "example-robot-data": "pip install 'equipoise[robots]'",
            "pybullet": "pip install pybullet",
        }[self.source]

    @property
    def install(self) -> str | None:
        """Command that installs the package, if it is missing."""
        return self.hint if self._path is None else None

    @property
    def _path(self) -> Path | None:
        folder = _package_folder(self.source)
        return folder / self.path if folder is not None and (folder / self.path).is_file() else None

    def find(self) -> Path:
        """Return the path of the model file.

        Raises:
            MissingDependencyError: its package is not installed.
        """
        path = self._path
        if path is None:
            raise MissingDependencyError(
                f"robot {self.name!r} comes with the package {self.source}, which is not installed: {self.hint}; "
                f"{BUILT_IN_ROBOT!r} is built in"
            )
        return path


_ERD, _PYBULLET = "example-robot-data", "pybullet"
CATALOG: dict[str, CatalogEntry] = {
    entry.name: entry
    for entry in (
        CatalogEntry(BUILT_IN_ROBOT, "equipoise", "a1.urdf", 12.458, "4 x 3", 0.4, "A1 of the paper"),
        CatalogEntry("a1", _ERD, "a1_description/urdf/a1.urdf", 13.741, "4 x 3", 0.4, "A1, newer"),
        CatalogEntry("go1", _ERD, "go1_description/urdf/go1.urdf", 13.1, "4 x 3", 0.426, "Unitree Go1"),
        CatalogEntry("go2", _ERD, "go2_description/urdf/go2.urdf", 16.085, "4 x 3", 0.426, "Unitree Go2"),
        CatalogEntry("b1", _ERD, "b1_description/urdf/b1.urdf", 55.689, "4 x 3", 0.7, "Unitree B1"),
        CatalogEntry("laikago", _ERD, "laikago_description/urdf/laikago.urdf", 25.433, "4 x 3", 0.5, "Unitree Laikago"),
        CatalogEntry(
            "anymal_b", _ERD, "anymal_b_simple_description/robots/anymal.urdf", 30.475, "4 x 3", 0.564, "ANYmal B"
        ),
        CatalogEntry(
            "anymal_c", _ERD, "anymal_c_simple_description/urdf/anymal.urdf", 52.135, "4 x 3", 0.613, "ANYmal C"
        ),
        CatalogEntry("hyq", _ERD, "hyq_description/robots/hyq_no_sensors.urdf", 86.774, "4 x 3", 0.696, "IIT HyQ"),
        CatalogEntry("solo8", _ERD, "solo_description/robots/solo.urdf", 2.178, "4 x 2", 0.32, "ODRI Solo 8"),
        CatalogEntry("solo12", _ERD, "solo_description/robots/solo12.urdf", 2.5, "4 x 3", 0.32, "ODRI Solo 12"),
        CatalogEntry("aliengo", _PYBULLET, "aliengo/aliengo.urdf", 20.638, "4 x 3", 0.5, "Unitree Aliengo"),
        CatalogEntry(
            "mini_cheetah", _PYBULLET, "mini_cheetah/mini_cheetah.urdf", 8.852, "4 x 3", 0.389, "MIT Mini Cheetah"
        ),
    )
}


_ROBOT_DESCRIPTIONS_PREFIX = "robot_descriptions:"
# Names in robot_descriptions of the catalogue's robots that MuJoCo Menagerie has.
_IN_MENAGERIE = {name: f"{name}_mj" for name in ("a1", "go1", "go2", "anymal_b", "anymal_c", "aliengo")}
_IN_MENAGERIE[BUILT_IN_ROBOT] = "a1_mj"


def load_robot(name_or_path: str | Path, description: RobotDescription | None = None) -> RobotModel:
    """Load a robot by its catalogue name, by the path of a URDF or MJCF file, or as `robot_descriptions:NAME`.

    Raises:
        ModelError: no such name or file, or the file is not a quadruped.
        MissingDependencyError: the package of a known name is not installed.
    """
    path, name = find_model(str(name_or_path))
    from equipoise.robot.model import RobotModel  # noqa: PLC0415 - a list of robots needs no Pinocchio

    return RobotModel.from_file(path, name, description)


def find_model(name_or_path: str) -> tuple[Path, str | None]:
    """Return the path of a robot's model file, and the robot's name, or None if the file has it.

    Raises:
        ModelError: no such name or file.
        MissingDependencyError: the package of a known name is not installed.
    """
    if name_or_path in CATALOG:
        return CATALOG[name_or_path].find(), name_or_path
    if name_or_path.startswith(_ROBOT_DESCRIPTIONS_PREFIX):
        module = name_or_path.removeprefix(_ROBOT_DESCRIPTIONS_PREFIX)
        return _find_robot_description(module), module
    path = Path(name_or_path)
    if not path.exists() and "/" not in name_or_path and "." not in name_or_path:
        name = name_or_path.lower().replace("-", "_")
        plain = name if name in CATALOG else name.removeprefix("unitree_")  # which is most of the built-in robot's name
        raise ModelError(
            f"no robot is called {name_or_path!r} and no such file exists; "
            f"{did_you_mean(plain, CATALOG) or did_you_mean(name, CATALOG)}known names are {', '.join(CATALOG)}; "
            "for others give the URDF or MJCF file, or robot_descriptions:NAME"
        )
    return path, None


def read_model_file(path: Path) -> bytes:
    """Return the content of a robot's model file; raises ModelError."""
    try:
        return read_bytes(path)
    except FileNotFoundError:
        raise ModelError(f"robot model {str(path)!r} does not exist; see 'equipoise robots' for known names") from None
    except IsADirectoryError:
        raise ModelError(
            f"robot model {str(path)!r} is a folder; give the URDF or MJCF file, or a name of 'equipoise robots' (a run's "
            "folder is for estimate, report and export)"
        ) from None
    except OSError as error:
        raise ModelError(f"robot model {str(path)!r} cannot be read: {error.strerror}") from error


def find_in_menagerie(robot: str) -> Path | None:
    """Return MuJoCo Menagerie's model file of a robot, by its catalogue name; None if there is none.

    Raises:
        MissingDependencyError: the package that fetches it is not installed.
        ModelError: it cannot be fetched.
    """
    name = robot.removesuffix("_description")
    return _find_robot_description(_IN_MENAGERIE[name]) if name in _IN_MENAGERIE else None


def _find_robot_description(name: str) -> Path:
    """Return a model file of the package robot_descriptions, which clones a repository on first use."""
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
