"""Unitree Go2 and B2 over DDS. Tested against an emulator of their messages, not on a real robot.

The robot must lie (or hang) when the first command is sent: docs/hardware/unitree-go2-b2.md.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from equipoise.drivers.checkup import CheckupFinding
from equipoise.drivers.dds.domain import DdsDomain, raw
from equipoise.drivers.robot_clock import RobotClock
from equipoise.drivers.unitree.dds_settings import UnitreeDdsSettings
from equipoise.drivers.unitree.dds_types import LowCmd, LowState
from equipoise.drivers.unitree.low_level import COMMAND, STATE, read_message
from equipoise.drivers.unitree.motors import MOTORS, STOP_POSITION, STOP_VELOCITY, joints_of_motors
from equipoise.drivers.unitree.remote_control import KEYS_AT, request_of
from equipoise.drivers.unitree.sport import MotionSwitcher, takeover_finding
from equipoise.errors import CommunicationError, MotionError, SettingsError
from equipoise.platform.platform import ACCEPTS_EVERYTHING, Health, JointCommand, RobotState
from equipoise.robot.kinematics import Kinematics
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance

COMMAND_TOPIC, STATE_TOPIC = "rt/lowcmd", "rt/lowstate"
CONTROL_PERIOD = 2e-3  # [s]
_TICK = 1e-3  # [s] of the robot's clock
_HEALTH = 0.1  # [s] between checks of temperatures and the battery
_LOST = 0.1  # share of messages between the robot's computer and a motor that may get lost
_LISTENING = 0.3  # [s] to detect other commanders: each motor needs a command every few milliseconds
_TURN = 5e-3  # [s] for the threads that receive
_PATIENCE = 3.0  # [s] with damaged samples only
_RELEASES = 10  # repetitions of the last command: some may get lost
_FOLDED = 0.5  # of a leg's length, between hip and foot, when a robot lies


class UnitreeDdsConnection:
    """Connection of a `HardwarePlatform` to a Go2 or a B2.

    Args:
        robot: model of a robot with three joints a leg.
        settings: settings of a Go2 or a B2.
        second: whether another process has taken over the robot, and this connection sends only while a robot is subscribed.

    Attributes:
        rejected: number of rejected samples: wrong checksum or length.
        unchecked: whether samples with wrong checksums are accepted.

    Raises:
        SettingsError: the robot has other legs, or a setting is not valid on this computer.
        CommunicationError: the domain cannot be opened.
    """

    def __init__(self, robot: RobotModel, settings: UnitreeDdsSettings, second: bool = False) -> None:
        self._robot, self._settings, self._second = robot, settings, second
        self.name, self.joint_names = f"{settings.kind} on {settings.interface}", robot.joint_names
        self.accepts, self.control_period = ACCEPTS_EVERYTHING, CONTROL_PERIOD
        self._joint_of_motor = joints_of_motors(robot, settings.kind)
        self._motor_of_joint = np.argsort(self._joint_of_motor)
        self._own_gains = robot.gains(nominal_stance(robot).hip_height)
        self._record = COMMAND.blank()
        self._record["motor_cmd"]["mode"] = settings.motor_mode
        self._motors: dict[str, NDArray[np.float32]] = {
            name: self._record["motor_cmd"][name] for name in ("q", "dq", "tau", "kp", "kd")
        }
        self._stop_motors()
        self._clock: RobotClock | None = None
        self._tick_was_zero = False
        self._newest: RobotState | None = None
        self._newest_record: NDArray[Any] | None = None
        self._health, self._examined, self._lost_before = Health(), -np.inf, np.zeros(MOTORS)
        self._taken_over = second
        self.rejected, self.unchecked = 0, not settings.check_crc
        self._opened = time.monotonic()
        self._domain = DdsDomain(settings.domain, settings.interface, settings.peers, settings.accept_cyclonedds)
        self._sample = raw(LowCmd)
        self._states = self._domain.inbox(STATE_TOPIC, raw(LowState))
        self._commands = self._domain.outbox(COMMAND_TOPIC, self._sample)
        self._others = None if second else self._domain.inbox(COMMAND_TOPIC, self._sample, own=False)
        self._switcher = MotionSwitcher(self._domain, self.name)

    def receive(self) -> list[RobotState]:
        """Return the samples that have arrived, as a connection does.

        Raises:
            CommunicationError: no more samples arrive, only damaged ones arrive, or several robots send samples.
            MotionError: another program commands the same motors.
        """
        self._check_one_robot()
        if self._taken_over:
            self._check_one_commander()
        samples = self._arrived()
        if not samples and self._silent_since() > self._settings.silence:
            time.sleep(_TURN)  # this computer may have been busy
            samples = self._arrived()
        self._note(samples)
        return samples

    def send(self, command: JointCommand) -> None:
        """Send a command. Before the first one the robot's own controller releases the motors, which takes seconds.

        Raises:
            MotionError: the controller holds the motors, and the robot does not lie; or another program commands the motors.
            CommunicationError: several robots are on the domain, or none.
            SettingsError: a process with an unsafe version of DDS has joined the domain.
        """
        if len(command.position) != MOTORS:
            raise SettingsError(f"commands for {len(command.position)} joints; {self.name} has {MOTORS}")
        if not self._taken_over:
            self._take_over()
        if self._second and not self._commands.readers:
            raise CommunicationError(f"no robot receives {self.name}: is the robot on, and is the cable plugged in?")
        table = command.table(*self._own_gains)[:, self._joint_of_motor]
        for motors, values in zip(self._motors.values(), table, strict=True):
            motors[:MOTORS] = values
        self._transmit()

    def check_takeover(self) -> list[CheckupFinding]:
        """Return the finding about the controller that holds the motors; the query does not release the motors."""
        return [takeover_finding(self._switcher, self._settings.release_sport_mode, self._may_release())]

    def motor_report(self) -> dict[str, list[int]]:
        """Return the newest "mode" of each motor, and its count of "lost" messages, in the model's joint order."""
        record = self._newest_record
        if record is None:
            return {}
        return {name: record["motor_state"][name][self._motor_of_joint].tolist() for name in ("mode", "lost")}

    def release(self) -> None:
        """Stop all motor torques. A robot that was never commanded is left to its own controller."""
        if not self._taken_over:
            return
        self._taken_over = False
        self._stop_motors()
        for _ in range(_RELEASES):
            self._transmit()
            time.sleep(CONTROL_PERIOD)

    def close(self) -> None:
        self._taken_over = False
        self._domain.close()

    def _transmit(self) -> None:
        self._commands.send(self._sample(COMMAND.encoded(self._record)))

    def _stop_motors(self) -> None:
        """Set commands without position, velocity and torque for all motors of a message."""
        for name, value in (("q", STOP_POSITION), ("dq", STOP_VELOCITY), ("tau", 0.0), ("kp", 0.0), ("kd", 0.0)):
            self._motors[name][:] = value

    def _take_over(self) -> None:
        self._domain.check_versions()  # others may have joined since
        self._check_one_robot()
        if not self._states.writers:
            raise CommunicationError(
                f"no robot sends {STATE_TOPIC} in {self._domain.where}: is it on, and is the cable plugged in?"
            )
        if self._settings.release_sport_mode and (mode := self._switcher.mode()):
            if not self._may_release():
                raise MotionError(
                    f"the controller {mode!r} of {self.name} holds its motors, and the robot does not lie: it would fall when "
                    "they are released. Make it lie down with its remote control; if it hangs in a frame, set hanging=true"
                )
            self._switcher.release()
        if self._others is not None:
            self._others.take()  # the robot's own controller may have commanded until now
            time.sleep(_LISTENING)
        self._check_one_commander()
        self._taken_over = True

    def _check_one_robot(self) -> None:
        """Raise CommunicationError if several robots are on the domain: all would execute the same commands."""
        if self._states.writers > 1:
            raise CommunicationError(
                f"{self._states.writers} robots send {STATE_TOPIC} in {self._domain.where}: "
                f"{', '.join(self._states.names_of_writers().values())}. All would execute the same commands: disconnect the "
                "others (one that was switched off counts for 10 s more), or give this robot its own domain: set domain"
            )

    def _check_one_commander(self) -> None:
        """Raise MotionError if another program sends commands; silent writers (second connections) are allowed."""
        others = [] if self._others is None else self._others.take()
        if others and self._others is not None:
            raise MotionError(
                f"another program commands the motors of {self.name}: {self._others.name_of_writer(others[0][1])} sent "
                f"{len(others)} commands on {COMMAND_TOPIC}. Both would move the robot: end that program, on this computer or "
                "on the robot (its own sport mode, if that was not released: docs/hardware/unitree-go2-b2.md)",
                other_commander=True,
            )

    def _may_release(self) -> bool:
        return self._settings.hanging or self._lies()

    def _lies(self) -> bool:
        """Return whether all legs are folded."""
        if self._newest is None:
            raise MotionError(f"{self.name} must be read before it is commanded, to check that it lies")
        kinematics, position = Kinematics(self._robot), self._newest.joint_position
        poses = kinematics.joint_poses(position)
        reach = [
            np.linalg.norm(foot - poses[leg.joint_ids[-2]].translation)
            for leg, foot in zip(self._robot.legs.values(), kinematics.foot_positions(position), strict=True)
        ]
        return bool(max(reach) <= _FOLDED * self._robot.leg_length)

    def _clock_of(self, tick: int) -> RobotClock | None:
        """Return the robot's clock, or this computer's if it does not advance; None before that is known."""
        if self._clock is None and (tick or self._tick_was_zero):
            self._clock = RobotClock(_TICK if tick else 0.0)
        self._tick_was_zero = tick == 0
        return self._clock

    def _arrived(self) -> list[RobotState]:
        samples: list[RobotState] = []
        for received, sample in self._states.take():
            record = read_message(STATE, sample.data, self._settings.check_crc)
            if record is None:
                self.rejected += 1
                continue
            self._newest_record = record
            if (clock := self._clock_of(int(record["tick"]))) is not None:
                samples.append(self._state(record, clock.time(int(record["tick"]), received), received))
        return samples

    def _silent_since(self) -> float:
        """Return the time since the last sample [s]; 0 before the first one."""
        newest = self._newest
        return 0.0 if newest is None or newest.received is None else time.monotonic() - newest.received

    def _state(self, record: NDArray[Any], at: float, received: float) -> RobotState:
        motors, imu, order = record["motor_state"], record["imu_state"], self._motor_of_joint
        if received - self._examined > _HEALTH:
            self._health = self._examine(record, received)
        return RobotState(
            at,
            motors["q"][order].astype(float),
            motors["dq"][order].astype(float),
            motors["tau_est"][order].astype(float),
            imu["gyroscope"].astype(float),
            imu["accelerometer"].astype(float),
            received=received,
            health=self._health,
            request=request_of(int.from_bytes(record["wireless_remote"][KEYS_AT].tobytes(), "little")),
        )

    def _examine(self, record: NDArray[Any], received: float) -> Health:
        """Return temperatures, battery, and messages lost inside the robot; zeros are empty fields of simulators."""
        motors, order = record["motor_state"], self._motor_of_joint
        temperature, voltage = motors["temperature"][order].astype(float), float(record["power_v"])
        lost, before = motors["lost"][order].astype(float), self._lost_before
        since, self._lost_before, self._examined = received - self._examined, lost, received
        losing = lost - before > _LOST * since / CONTROL_PERIOD  # infinite `since` the first time: none
        fault = (
            "messages to motors get lost: " + ", ".join(np.array(self.joint_names)[losing]) if losing.any() else None
        )
        return Health(
            temperature if temperature.any() else None,
            voltage or None,
            float(record["bms_state"]["soc"]) / 100 if voltage else None,
            fault,
        )

    def _note(self, samples: list[RobotState]) -> None:
        """Keep the newest sample; raise CommunicationError for a silent robot or only damaged samples."""
        if samples:
            self._newest = samples[-1]
        elif self._newest is None:
            if self.rejected and time.monotonic() - self._opened > _PATIENCE:
                raise CommunicationError(
                    f"{self.name} sends no valid samples: all {self.rejected} samples had a wrong length or checksum. Is it "
                    "this kind of robot? check_crc=false accepts samples with wrong checksums"
                )
        elif (since := self._silent_since()) > self._settings.silence:
            raise CommunicationError(
                f"{self.name} has been silent for {since:.1f} s: is the robot on, and is the cable plugged in?"
            )


def open_connection(robot: RobotModel, settings: UnitreeDdsSettings) -> UnitreeDdsConnection:
    """Open the connection to a Go2 or a B2; the settings determine which."""
    return UnitreeDdsConnection(robot, settings)


def open_second_connection(robot: RobotModel, settings: UnitreeDdsSettings) -> UnitreeDdsConnection:
    """Open the second connection; see `open_second` of `drivers/platforms.py`."""
    return UnitreeDdsConnection(robot, settings, second=True)
