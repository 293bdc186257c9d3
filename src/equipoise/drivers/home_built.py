"""Platforms from classes of other packages: `--platform MODULE:CLASS`, or an entry point of a class."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.drivers.checkup import CheckupFinding, takeover_findings
from equipoise.drivers.platform_settings import read_values, settings_of_platform
from equipoise.drivers.plugin_errors import translated
from equipoise.errors import CommunicationError, EquipoiseError, MissingDependencyError, MotionError
from equipoise.platform.platform import JointCommand, RobotState
from equipoise.platform.stepped import SteppedPlatform
from equipoise.robot.model import RobotModel

if TYPE_CHECKING:
    from equipoise.drivers.hardware import RobotConnection


def open_home_built(name: str, kind: type[Any], robot: RobotModel, given: Mapping[str, Any]) -> HomeBuilt:
    """Create a platform as CLASS(robot, **settings).

    Raises:
        SettingsError: a setting does not exist, or its value is invalid.
        CommunicationError: the constructor raises an OSError.
        MissingDependencyError: the constructor raises another error, or its object is not a platform.
    """
    settings = read_values(settings_of_platform(kind), given, name)
    try:
        made = kind(robot, **settings)
    except EquipoiseError:
        raise
    except OSError as error:
        raise CommunicationError(f"platform {name!r} cannot be opened: {error}") from error
    except Exception as error:
        raise MissingDependencyError(
            f"platform {name!r} cannot be created ({type(error).__name__}: {error}): the call is "
            f"{kind.__name__}(robot, **settings), with the RobotModel and the settings of --set"
        ) from error
    return HomeBuilt(name, made, robot)


def open_second_of_class(
    name: str, kind: type[Any], robot: RobotModel, given: Mapping[str, Any]
) -> RobotConnection | None:
    """Return the second connection from a class method `second(robot, **settings)`; None if there is none."""
    make = getattr(kind, "second", None)
    if make is None:
        return None
    return translated(name, "second", lambda: make(robot, **read_values(settings_of_platform(kind), given, name)))


class HomeBuilt(SteppedPlatform):
    """Platform of another package with checked samples; its exceptions become equipoise errors.

    Args:
        name: name in messages.
        inner: platform itself, with `read`, `step`, `close` and `control_period`.
        robot: model of the robot.

    Raises:
        MissingDependencyError: its `control_period`, `joint_names` or `accepts` is invalid.
    """

    def __init__(self, name: str, inner: Any, robot: RobotModel) -> None:
        super().__init__(robot)
        self.name, self._inner = name, inner
        period = getattr(inner, "control_period", None)
        if not isinstance(period, (int, float)) or not (math.isfinite(period) and period > 0):
            raise MissingDependencyError(
                f"platform {name!r}: its control_period is {period!r}; it must be a time [s] above zero"
            )
        names = getattr(inner, "joint_names", robot.joint_names)
        if tuple(names) != robot.joint_names:
            raise MissingDependencyError(
                f"platform {name!r}: its joint_names are {', '.join(names)}; they must be the model's, in its order: "
                f"{', '.join(robot.joint_names)}"
            )
        self.control_period = float(period)
        self.accepts = frozenset(getattr(inner, "accepts", ()))

    def read(self) -> RobotState:
        return self._sensed("read", self._inner.read)

    def step(self, command: JointCommand) -> RobotState:
        return self._sensed("step", lambda: self._inner.step(command))

    def close(self) -> None:
        translated(self.name, "close", self._inner.close)

    def check_takeover(self) -> list[CheckupFinding]:
        """Return the platform's findings about its first command; send no command."""
        return takeover_findings(self._inner)

    def _sensed(self, method: str, act: Callable[[], Any]) -> RobotState:
        state = translated(self.name, method, act)
        if not isinstance(state, RobotState):
            raise MotionError(
                f"platform {self.name!r}: {method} returns a {type(state).__name__}; it must be a RobotState"
            )
        joints = (len(self.joint_names),)
        for field, shape in (("joint_position", joints), ("angular_velocity_in_imu", (3,)), ("acceleration_in_imu", (3,)),
                             ("joint_velocity", joints), ("joint_torque", joints)):  # fmt: skip
            value: Any = getattr(state, field)
            if value is None and field in ("joint_velocity", "joint_torque"):
                continue
            found = cast("FloatArray", value).shape if isinstance(value, np.ndarray) else type(value).__name__
            if found != shape:
                raise MotionError(
                    f"platform {self.name!r}: {method} returns {found} as {field}; it must be an array of shape {shape}"
                )
        return state
