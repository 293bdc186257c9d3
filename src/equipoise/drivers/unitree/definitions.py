"""Messages of Unitree's Go2 and B2: types and names of their fields, in the order on the wire."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

PLACES = 20
"""Places for motors in every message; a quadruped uses the first twelve."""

LOW_LEVEL = {
    "unitree_go/MotorCmd": "uint8 mode, float32 q, float32 dq, float32 tau, float32 kp, float32 kd, uint32[3] reserve",
    "unitree_go/BmsCmd": "uint8 off, uint8[3] reserve",
    "unitree_go/LowCmd": (
        "uint8[2] head, uint8 level_flag, uint8 frame_reserve, uint32[2] sn, uint32[2] version, uint16 bandwidth, "
        f"unitree_go/MotorCmd[{PLACES}] motor_cmd, unitree_go/BmsCmd bms_cmd, uint8[40] wireless_remote, uint8[12] led, "
        "uint8[2] fan, uint8 gpio, uint32 reserve, uint32 crc"
    ),
    "unitree_go/IMUState": (
        "float32[4] quaternion, float32[3] gyroscope, float32[3] accelerometer, float32[3] rpy, int8 temperature"
    ),
    "unitree_go/MotorState": (
        "uint8 mode, float32 q, float32 dq, float32 ddq, float32 tau_est, float32 q_raw, float32 dq_raw, float32 ddq_raw, "
        "int8 temperature, uint32 lost, uint32[2] reserve"
    ),
    "unitree_go/BmsState": (
        "uint8 version_high, uint8 version_low, uint8 status, uint8 soc, int32 current, uint16 cycle, int8[2] bq_ntc, "
        "int8[2] mcu_ntc, uint16[15] cell_vol"
    ),
    "unitree_go/LowState": (
        "uint8[2] head, uint8 level_flag, uint8 frame_reserve, uint32[2] sn, uint32[2] version, uint16 bandwidth, "
        f"unitree_go/IMUState imu_state, unitree_go/MotorState[{PLACES}] motor_state, unitree_go/BmsState bms_state, "
        "int16[4] foot_force, int16[4] foot_force_est, uint32 tick, uint8[40] wireless_remote, uint8 bit_flag, "
        "float32 adc_reel, int8 temperature_ntc1, int8 temperature_ntc2, float32 power_v, float32 power_a, "
        "uint16[4] fan_frequency, uint32 reserve, uint32 crc"
    ),
}
"""Commands and states of every control period. The quaternion is w x y z, `tick` counts milliseconds, `soc` is the charge of
the battery in per cent, its current is in mA."""

SERVICES = {
    "unitree_api/RequestIdentity": "int64 id, int64 api_id",
    "unitree_api/RequestLease": "int64 id",
    "unitree_api/RequestPolicy": "int32 priority, bool noreply",
    "unitree_api/RequestHeader": (
        "unitree_api/RequestIdentity identity, unitree_api/RequestLease lease, unitree_api/RequestPolicy policy"
    ),
    "unitree_api/Request": "unitree_api/RequestHeader header, string parameter, uint8[] binary",
    "unitree_api/ResponseStatus": "int32 code",
    "unitree_api/ResponseHeader": "unitree_api/RequestIdentity identity, unitree_api/ResponseStatus status",
    "unitree_api/Response": "unitree_api/ResponseHeader header, string data, uint8[] binary",
}
"""Requests to services and their responses. Parameter and data are JSON; a response has the identity of its request, and
status zero on success."""


def layout_of(definition: str, parts: Mapping[str, str], align: bool) -> np.dtype[Any]:
    """Return the structured type of a record's fields in order, little endian.

    Args:
        definition: types and names of the fields, as above; a type is NumPy's name of a number or one of `parts`.
        parts: definitions of the records in it, by name.
        align: whether each field is aligned, as by C compilers; otherwise there is no padding.
    """
    fields: list[tuple[str, np.dtype[Any], tuple[int, ...]]] = []
    for kind, name in (each.split() for each in definition.split(", ")):
        kind, _, count = kind.rstrip("]").partition("[")  # noqa: PLW2901
        part = layout_of(parts[kind], parts, align) if kind in parts else np.dtype(kind).newbyteorder("<")
        fields.append((name, part, (int(count),) if count else ()))
    return np.dtype(fields, align=align)
