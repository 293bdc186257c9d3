"""Emulator of a Go2 or B2 with their DDS messages, on this computer only.

    equipoise lab emulate unitree-dds --robot unitree_a1 --domain 1

It works with any quadruped with three joints per leg, and lies by default. As on the real robots, its own controller
("normal") holds the motors until the motion_switcher service releases them. Earlier commands are ignored; a real robot's
controller would act against them.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from equipoise.drivers.dds.domain import LOOPBACK, DdsDomain, raw
from equipoise.drivers.unitree.dds import COMMAND_TOPIC, CONTROL_PERIOD, STATE_TOPIC
from equipoise.drivers.unitree.dds_types import LowCmd, LowState, Request, Response, ResponseHeader, ResponseStatus
from equipoise.drivers.unitree.low_level import COMMAND, STATE, read_message
from equipoise.drivers.unitree.motors import MOTORS, joints_of_motors
from equipoise.drivers.unitree.remote_control import KEYS_AT, keys_of
from equipoise.drivers.unitree.sport import CHECK_MODE, RELEASE_MODE, REQUESTS, RESPONSES
from equipoise.lab.emulators.faults import ActiveFaults, FaultySamples
from equipoise.lab.emulators.options import UnitreeDdsOptions
from equipoise.lab.emulators.unitree_motors import of_motor_boards
from equipoise.platform.platform import JointCommand, RobotState
from equipoise.robot.model import RobotModel

_SPORT_MODE = "normal"
_RELEASE_DELAY = 0.3  # [s] from a release request to the end of the robot's own controller
_NO_SUCH_FUNCTION = 3203  # status code
_ANOTHER_GAIN = 0.1  # relative change of gains that is logged
_IMU_TEMPERATURE = 60  # [deg C]
_VOLTAGE, _CURRENT = 29.4, 2.1  # [V], [A]


class UnitreeDdsWire:
    """Robot side of the protocol.

    Args:
        robot: model of the simulated robot.
        options: settings of the protocol.
        log: function that logs an entry.
    """

    def __init__(self, robot: RobotModel, options: UnitreeDdsOptions, log: Callable[..., None]) -> None:
        self._options, self._log = options, log
        self._joint_of_motor = joints_of_motors(robot, "the protocol")
        self._motor_of_joint = np.argsort(self._joint_of_motor)
        self._record, self._faulty = STATE.blank(), FaultySamples(CONTROL_PERIOD)
        self._mode = _SPORT_MODE if options.sport_mode and not options.bare else ""
        self._release_time: float | None = None
        self._now = 0.0
        self._position = np.zeros(MOTORS)
        self._gains = np.nan, np.nan
        self.received = self.damaged = self.fought = 0
        self._domain = DdsDomain(options.domain, LOOPBACK)
        self._state_type = raw(LowState)
        self._commands = self._domain.inbox(COMMAND_TOPIC, raw(LowCmd))
        self._states = self._domain.outbox(STATE_TOPIC, self._state_type)
        if not options.bare:
            self._requests = self._domain.inbox(REQUESTS, Request)
            self._responses = self._domain.outbox(RESPONSES, Response)

    def commands(self) -> list[JointCommand]:
        """Return the commands as in `Wire`, and a limp command when the robot's own controller ends."""
        commands = [] if self._options.bare else self._serve()
        for _, sample in self._commands.take():
            record = read_message(COMMAND, sample.data, check=not self._options.bare)
            if record is None:
                self._note("damaged")
            elif self._mode:
                self._note("fought")
            else:
                self.received += 1
                commands.append(self._for_joints(record["motor_cmd"]))
        return commands

    def publish(self, state: RobotState, faults: ActiveFaults) -> None:
        self._now, self._position = state.time, state.joint_position
        self._fill(state, faults)
        data = STATE.encoded(self._record)
        if self._options.bare:
            data = data[:-4] + bytes(4)
        for sample in self._faulty.sent(data, faults):
            self._states.send(self._state_type(sample))

    def close(self) -> None:
        self._log(received=self.received, damaged=self.damaged, fought=self.fought)
        self._domain.close()

    def _serve(self) -> list[JointCommand]:
        """Answer requests to the motion_switcher service."""
        for _, request in self._requests.take():
            function, code = request.header.identity.api_id, 0
            self._log(request=function)
            if function == RELEASE_MODE:
                self._log(asked="release")
                self._release_time = self._now + _RELEASE_DELAY if self._release_time is None else self._release_time
            elif function != CHECK_MODE:
                code = _NO_SUCH_FUNCTION
            data = json.dumps({"form": "0", "name": self._mode})
            self._responses.send(Response(ResponseHeader(request.header.identity, ResponseStatus(code)), data))
        if self._mode and self._release_time is not None and self._now >= self._release_time:
            self._mode = ""
            self._log(sport_mode="ended")
            return [JointCommand(self._position, kp=np.zeros(MOTORS), kd=np.zeros(MOTORS))]
        return []

    def _for_joints(self, motors: NDArray[Any]) -> JointCommand:
        """Return the command that the motor boards execute."""
        order = self._motor_of_joint
        table = np.array([motors[name][order] for name in ("q", "dq", "tau", "kp", "kd")], dtype=float)
        gains = float(table[3].mean()), float(table[4].mean())
        if not np.allclose(gains, self._gains, rtol=_ANOTHER_GAIN, atol=0):
            self._gains = gains
            self._log(kp=round(gains[0], 3), kd=round(gains[1], 3), motor_mode=int(motors["mode"][0]))
        return of_motor_boards(table, self._position, motors["mode"][order] != 0)

    def _fill(self, state: RobotState, faults: ActiveFaults) -> None:
        record, order = self._record, self._joint_of_motor
        motors, imu = record["motor_state"], record["imu_state"]
        motors["q"][:MOTORS] = state.joint_position[order]
        for name, values in (("dq", state.joint_velocity), ("tau_est", state.joint_torque)):
            if values is not None:
                motors[name][:MOTORS] = values[order]
        motors["temperature"][:MOTORS] = round(faults.temperature)
        imu["quaternion"] = (1.0, 0.0, 0.0, 0.0)  # there is no orientation filter
        imu["gyroscope"], imu["accelerometer"] = state.angular_velocity_in_imu, state.acceleration_in_imu
        imu["temperature"] = _IMU_TEMPERATURE
        record["power_v"], record["power_a"] = _VOLTAGE, _CURRENT
        record["bms_state"]["soc"] = round(100 * faults.charge)
        record["wireless_remote"][KEYS_AT] = tuple(keys_of(faults.press).to_bytes(2, "little"))
        if not self._options.bare:
            record["tick"] = (self._options.first_tick + round(state.time * 1000)) % 2**32

    def _note(self, what: str) -> None:
        """Count an ignored message, and log the first."""
        count = getattr(self, what) + 1
        setattr(self, what, count)
        if count == 1:
            self._log(ignored=what)
