"""Messages of Unitree's Go2 and B2 as DDS types.

uint8 and int8 are byte, for compatibility between versions of DDS: see `cyclone.py`.
"""

from __future__ import annotations

from equipoise.drivers.dds.domain import message_types
from equipoise.drivers.unitree.definitions import LOW_LEVEL, SERVICES

MotorCmd, BmsCmd, LowCmd, IMUState, MotorState, BmsState, LowState = message_types(LOW_LEVEL)
(
    RequestIdentity, RequestLease, RequestPolicy, RequestHeader, Request, ResponseStatus, ResponseHeader, Response
) = message_types(SERVICES)  # fmt: skip
