"""Types of the messages that logs are read from, for bags that do not carry the definitions of their own types.

Unitree's Go2 and B2 publish `unitree_go`. The messages of its older robots differ between versions of the SDK; bags of ROS 1
carry the definitions.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Any

from equipoise.drivers.unitree.definitions import LOW_LEVEL
from equipoise.drivers.unitree.motors import MOTORS

JOINT_STATE, IMU = "sensor_msgs/msg/JointState", "sensor_msgs/msg/Imu"
LOW_STATE, LOW_CMD = "unitree_go/msg/LowState", "unitree_go/msg/LowCmd"

_LEGGED = ("motorState", "tauEst", "imu", "footForce")  # A1, Go1, Aliengo by ROS 1
_LEGGED_ROS2 = ("motor_state", "tau_est", "imu", "foot_force")
STATES: Mapping[str, tuple[str, str, str, str]] = {
    LOW_STATE: ("motor_state", "tau_est", "imu_state", "foot_force"),
    "unitree_legged_msgs/msg/LowState": _LEGGED,
    "unitree_legged_msgs/msg/HighState": _LEGGED,  # of robots that walk by their maker's controller
    "ros2_unitree_legged_msgs/msg/LowState": _LEGGED_ROS2,
    "ros2_unitree_legged_msgs/msg/HighState": _LEGGED_ROS2,
}
"""Unitree's messages with all joints and the IMU on one clock, by type: names of the fields of motors, of a motor's torque,
of the IMU and of the forces at the feet."""

COMMANDS: Mapping[str, str] = {
    LOW_CMD: "motor_cmd", "unitree_legged_msgs/msg/LowCmd": "motorCmd", "ros2_unitree_legged_msgs/msg/LowCmd": "motor_cmd",
}  # fmt: skip
"""Unitree's messages with commands, by type: name of the field of motors."""

MOTOR_NAMES = tuple(f"motor {index}" for index in range(MOTORS))
"""Names of the motors of STATES and COMMANDS, in the order of MOTOR_LEGS; the motors after them do not exist."""


@lru_cache(maxsize=1)
def known_types() -> Mapping[str, Any]:
    """Return the field definitions of ROS 2's own types and of `unitree_go`, by name."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415 - half a second to import

    types: dict[str, Any] = dict(get_typestore(Stores.ROS2_HUMBLE).fielddefs)
    for name, definition in LOW_LEVEL.items():
        types.update(get_types_from_msg(definition.replace(", ", "\n"), name.replace("/", "/msg/")))
    return MappingProxyType(types)


def store_of(types: Mapping[str, Any]) -> Any:
    """Return field definitions as a `Typestore`, which converts messages of ROS 1 to ROS 2."""
    from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415

    store = get_typestore(Stores.EMPTY)
    store.register(dict(types))
    return store
