"""Types of the messages that logs are read from, for bags that do not carry the definitions of their own types.

`unitree_go` is what Unitree's Go2 and B2 publish: facts of its fields, in their order on the wire. What their older robots
publish has other fields with every version of the SDK; bags of ROS 1 carry the definitions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import Any

from equipoise.drivers.unitree.motors import MOTORS

JOINT_STATE, IMU = "sensor_msgs/msg/JointState", "sensor_msgs/msg/Imu"
LOW_STATE, LOW_CMD = "unitree_go/msg/LowState", "unitree_go/msg/LowCmd"


@dataclass(frozen=True)
class StateFields:
    """What a message that holds all joints and the IMU calls its parts."""

    motors: str
    torque: str
    imu: str
    foot_force: str


_LEGGED = StateFields("motorState", "tauEst", "imu", "footForce")  # A1, Go1, Aliengo by ROS 1
_LEGGED_ROS2 = StateFields("motor_state", "tau_est", "imu", "foot_force")
STATES: Mapping[str, StateFields] = {
    LOW_STATE: StateFields("motor_state", "tau_est", "imu_state", "foot_force"),
    "unitree_legged_msgs/msg/LowState": _LEGGED,
    "unitree_legged_msgs/msg/HighState": _LEGGED,  # of robots that walk by their maker's controller
    "ros2_unitree_legged_msgs/msg/LowState": _LEGGED_ROS2,
    "ros2_unitree_legged_msgs/msg/HighState": _LEGGED_ROS2,
}
"""Unitree's messages with all joints and the IMU on one clock, by type."""

COMMANDS: Mapping[str, str] = {
    LOW_CMD: "motor_cmd", "unitree_legged_msgs/msg/LowCmd": "motorCmd", "ros2_unitree_legged_msgs/msg/LowCmd": "motor_cmd",
}  # fmt: skip
"""What Unitree's messages with commands call the motors' part, by type."""

MOTOR_NAMES = tuple(f"motor {index}" for index in range(MOTORS))
"""Of STATES and COMMANDS, in the order of MOTOR_LEGS; the motors after them do not exist."""

_UNITREE_GO = {
    "unitree_go/msg/IMUState": """
        float32[4] quaternion
        float32[3] gyroscope
        float32[3] accelerometer
        float32[3] rpy
        int8 temperature
    """,
    "unitree_go/msg/MotorState": """
        uint8 mode
        float32 q
        float32 dq
        float32 ddq
        float32 tau_est
        float32 q_raw
        float32 dq_raw
        float32 ddq_raw
        int8 temperature
        uint32 lost
        uint32[2] reserve
    """,
    "unitree_go/msg/BmsState": """
        uint8 version_high
        uint8 version_low
        uint8 status
        uint8 soc
        int32 current
        uint16 cycle
        int8[2] bq_ntc
        int8[2] mcu_ntc
        uint16[15] cell_vol
    """,
    LOW_STATE: """
        uint8[2] head
        uint8 level_flag
        uint8 frame_reserve
        uint32[2] sn
        uint32[2] version
        uint16 bandwidth
        unitree_go/IMUState imu_state
        unitree_go/MotorState[20] motor_state
        unitree_go/BmsState bms_state
        int16[4] foot_force
        int16[4] foot_force_est
        uint32 tick
        uint8[40] wireless_remote
        uint8 bit_flag
        float32 adc_reel
        int8 temperature_ntc1
        int8 temperature_ntc2
        float32 power_v
        float32 power_a
        uint16[4] fan_frequency
        uint32 reserve
        uint32 crc
    """,
    "unitree_go/msg/MotorCmd": """
        uint8 mode
        float32 q
        float32 dq
        float32 tau
        float32 kp
        float32 kd
        uint32[3] reserve
    """,
    "unitree_go/msg/BmsCmd": """
        uint8 off
        uint8[3] reserve
    """,
    LOW_CMD: """
        uint8[2] head
        uint8 level_flag
        uint8 frame_reserve
        uint32[2] sn
        uint32[2] version
        uint16 bandwidth
        unitree_go/MotorCmd[20] motor_cmd
        unitree_go/BmsCmd bms_cmd
        uint8[40] wireless_remote
        uint8[12] led
        uint8[2] fan
        uint8 gpio
        uint32 reserve
        uint32 crc
    """,
}


@lru_cache(maxsize=1)
def known_types() -> Mapping[str, Any]:
    """Field definitions of ROS 2's own types and of `unitree_go`, by name."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415 - half a second to import

    types: dict[str, Any] = dict(get_typestore(Stores.ROS2_HUMBLE).fielddefs)
    for name, definition in _UNITREE_GO.items():
        types.update(get_types_from_msg("\n".join(line.strip() for line in definition.splitlines()), name))
    return MappingProxyType(types)


def store_of(types: Mapping[str, Any]) -> Any:
    """Field definitions as a `Typestore`, which can write messages of ROS 1 anew as ROS 2 has them."""
    from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415

    store = get_typestore(Stores.EMPTY)
    store.register(dict(types))
    return store
