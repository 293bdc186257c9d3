"""A robot by name or by file."""

from __future__ import annotations

import importlib
from difflib import get_close_matches
from pathlib import Path

from equipoise.errors import MissingDependencyError, ModelError
from equipoise.robot.catalog import CATALOG
from equipoise.robot.description import RobotDescription
from equipoise.robot.model import RobotModel

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
