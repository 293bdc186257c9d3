"""A simulated Go2 or B2 that speaks their messages over DDS, on this computer alone.

    python -m equipoise.lab.emulators.unitree_dds --robot unitree_a1 --domain 1

Any quadruped with three joints a leg can. It lies, unless it is told to stand. As on the robots a controller of its own
holds the motors ("normal") until the motion_switcher service has it let go; what is commanded before that is ignored, where a
real robot would fight it.
"""

from __future__ import annotations

import json
import signal
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray
from tyro.conf import OmitArgPrefixes

from equipoise.drivers.dds.domain import LOOPBACK, DdsDomain, raw
from equipoise.drivers.unitree.dds import COMMAND_TOPIC, CONTROL_PERIOD, STATE_TOPIC
from equipoise.drivers.unitree.dds_types import LowCmd, LowState, Request, Response, ResponseHeader, ResponseStatus
from equipoise.drivers.unitree.low_level import COMMAND, STATE, STOP_POSITION, STOP_VELOCITY, Message, read_message
from equipoise.drivers.unitree.motors import MOTORS, joints_of_motors
from equipoise.drivers.unitree.remote_control import KEYS_AT, keys_of
from equipoise.drivers.unitree.sport import CHECK_MODE, RELEASE_MODE, REQUESTS, RESPONSES
from equipoise.lab.emulators.emulated_robot import PeerRobot, PeerSettings
from equipoise.lab.emulators.faults import ActiveFaults, FaultySamples
from equipoise.platform.platform import JointCommand, RobotState
from equipoise.robot.catalog import load_robot
from equipoise.robot.model import RobotModel

_SPORT_MODE = "normal"
_LETS_GO = 0.3  # [s] after which the robot's own controller has ended
_NO_SUCH_FUNCTION = 3203  # status code
_ANOTHER_GAIN = 0.1  # change that is worth a line
_IMU_TEMPERATURE = 60  # [deg C]
_VOLTAGE, _CURRENT = 29.4, 2.1  # [V], [A]


@dataclass(frozen=True)
class WireSettings:
    """How the simulated robot speaks.

    Attributes:
        domain: number of the DDS domain, on "lo".
        sport_mode: whether a controller of its own holds the motors at the beginning.
        first_tick: first count of its clock [ms]; it begins anew at 2^32.
        bare: whether tick and checksum stay zero, as in the public simulator; there is no motion_switcher service
            either.
    """

    domain: int = 1
    sport_mode: bool = True
    first_tick: int = 1_000_000
    bare: bool = False


class UnitreeDdsWire:
    """The robot's side.

    Args:
        robot: model of the simulated robot.
        settings: settings of the wire.
        say: function that takes what is worth noting.
    """

    def __init__(self, robot: RobotModel, settings: WireSettings, say: Callable[..., None]) -> None:
        self._settings, self._say = settings, say
        self._joint_of_motor = joints_of_motors(robot, "the protocol")
        self._motor_of_joint = np.argsort(self._joint_of_motor)
        self._message, self._faulty = Message(STATE), FaultySamples(CONTROL_PERIOD)
        self._mode = _SPORT_MODE if settings.sport_mode and not settings.bare else ""
        self._lets_go: float | None = None
        self._now = 0.0
        self._position = np.zeros(MOTORS)
        self._gains = np.nan, np.nan
        self.received = self.damaged = self.fought = 0
        self._domain = DdsDomain(settings.domain, LOOPBACK)
        self._state_type = raw(LowState)
        self._commands = self._domain.inbox(COMMAND_TOPIC, raw(LowCmd))
        self._states = self._domain.outbox(STATE_TOPIC, self._state_type)
        if not settings.bare:
            self._requests = self._domain.inbox(REQUESTS, Request)
            self._responses = self._domain.outbox(RESPONSES, Response)

    def commands(self) -> list[JointCommand]:
        """As a wire's; a limp command when the robot's own controller has let go."""
        commands = [] if self._settings.bare else self._serve()
        for _, sample in self._commands.take():
            record = read_message(COMMAND, sample.data, check=not self._settings.bare)
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
        data = self._message.encoded()
        if self._settings.bare:
            data = data[:-4] + bytes(4)
        for sample in self._faulty.sent(data, faults):
            self._states.send(self._state_type(sample))

    def close(self) -> None:
        self._say(received=self.received, damaged=self.damaged, fought=self.fought)
        self._domain.close()

    def _serve(self) -> list[JointCommand]:
        """Answer requests to the motion_switcher service."""
        for _, request in self._requests.take():
            function, code = request.header.identity.api_id, 0
            self._say(request=function)
            if function == RELEASE_MODE:
                self._say(asked="release")
                self._lets_go = self._now + _LETS_GO if self._lets_go is None else self._lets_go
            elif function != CHECK_MODE:
                code = _NO_SUCH_FUNCTION
            data = json.dumps({"form": "0", "name": self._mode})
            self._responses.send(Response(ResponseHeader(request.header.identity, ResponseStatus(code)), data))
        if self._mode and self._lets_go is not None and self._now >= self._lets_go:
            self._mode = ""
            self._say(sport_mode="ended")
            return [JointCommand(self._position, kp=np.zeros(MOTORS), kd=np.zeros(MOTORS))]
        return []

    def _for_joints(self, motors: NDArray[Any]) -> JointCommand:
        """Return the command as motor boards take it: a value that means stop is not controlled, a motor off is limp."""
        order = self._motor_of_joint
        on = motors["mode"][order] != 0
        position, velocity, torque, kp, kd = (
            motors[name][order].astype(float) for name in ("q", "dq", "tau", "kp", "kd")
        )
        holds, brakes = on & (np.abs(position) < STOP_POSITION / 2), on & (np.abs(velocity) < STOP_VELOCITY / 2)
        gains = float(kp.mean()), float(kd.mean())
        if not np.allclose(gains, self._gains, rtol=_ANOTHER_GAIN, atol=0):
            self._gains = gains
            self._say(kp=round(gains[0], 3), kd=round(gains[1], 3), motor_mode=int(motors["mode"][0]))
        return JointCommand(
            np.where(holds, position, self._position),
            np.where(brakes, velocity, 0.0),
            np.where(on, torque, 0.0),
            np.where(holds, kp, 0.0),
            np.where(brakes, kd, 0.0),
        )

    def _fill(self, state: RobotState, faults: ActiveFaults) -> None:
        record, order = self._message.record, self._joint_of_motor
        motors, imu = record["motor_state"], record["imu_state"]
        motors["q"][:MOTORS] = state.joint_position[order]
        for name, values in (("dq", state.joint_velocity), ("tau_est", state.joint_torque)):
            if values is not None:
                motors[name][:MOTORS] = values[order]
        motors["temperature"][:MOTORS] = round(faults.temperature)
        imu["quaternion"] = (1.0, 0.0, 0.0, 0.0)  # a real robot's filter knows better
        imu["gyroscope"], imu["accelerometer"] = state.angular_velocity_in_imu, state.acceleration_in_imu
        imu["temperature"] = _IMU_TEMPERATURE
        record["power_v"], record["power_a"], record["bms_state"]["soc"] = (
            _VOLTAGE,
            _CURRENT,
            round(100 * faults.charge),
        )
        record["wireless_remote"][KEYS_AT] = tuple(keys_of(faults.press).to_bytes(2, "little"))
        if not self._settings.bare:
            record["tick"] = (self._settings.first_tick + round(state.time * 1000)) % 2**32

    def _note(self, what: str) -> None:
        """Count what is ignored; say so the first time."""
        count = getattr(self, what) + 1
        setattr(self, what, count)
        if count == 1:
            self._say(ignored=what)


@dataclass(frozen=True)
class UnitreeDdsOptions:
    """A simulated Go2 or B2 on DDS; logs JSON, one object a line.

    Attributes:
        robot: quadruped that it is: a name, or a URDF or MJCF file.
        peer: settings of the simulated robot.
        wire: settings of the wire.
    """

    robot: str = "unitree_a1"
    peer: OmitArgPrefixes[PeerSettings] = field(default_factory=lambda: PeerSettings(start="lying"))
    wire: OmitArgPrefixes[WireSettings] = field(default_factory=WireSettings)


def serve(options: UnitreeDdsOptions) -> None:
    """Run until Ctrl-C or SIGTERM."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # a process in the background may be deaf to Ctrl-C
    robot = load_robot(options.robot)
    peer = PeerRobot(robot, options.peer)
    peer.serve(UnitreeDdsWire(robot, options.wire, peer.say))


def main() -> None:
    """Run with the flags of the command line."""
    serve(tyro.cli(UnitreeDdsOptions))


if __name__ == "__main__":
    main()
