"""Faults of a simulated robot: pushes, sensors that fail, samples damaged on the wire, a cable that comes off, crossed wiring.

A fault is a line of JSON on the emulator's standard input, as in

    {"push": [0, 100, 0], "for": 0.3, "when": "lift"}
    {"press": "L2+B", "after": 12}

"after" is the robot time since the first command at which it begins [s], "when": "lift" the next moment in which two feet are
off the floor; without either it begins at once. "for" is how long it lasts [s]; without it, it lasts until its value is given
again.
"""

from __future__ import annotations

import json
import os
import select
import sys
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any, Literal

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.drivers.unitree.remote_control import KEYS
from equipoise.platform.platform import Health, JointCommand, RobotState
from equipoise.robot.model import RobotModel

Wiring = Literal["right", "hip-signs", "left-right", "front-rear", "legs-reversed", "imu-quarter-turn"]
WiringOf = Literal["both", "commands", "samples"]

_LEG_ORDERS = {"left-right": ("FR", "FL", "RR", "RL"), "front-rear": ("RL", "RR", "FL", "FR"),
               "legs-reversed": ("RR", "RL", "FR", "FL")}  # fmt: skip
_CLAMP = 30.0  # times a joint's own stiffness, and 10 times its damping, with which a blocked joint is held
_REPLAYED = 250  # samples between a sample and its repetition
_OFF_THE_FLOOR = 5e-3  # [m] of clearance with which a foot counts as lifted
_CHECKSUM_SIZE = 4  # [bytes] at the end of every sample


@dataclass
class ActiveFaults:
    """Faults that act now; the defaults are a sound robot. A joint is its name.

    Attributes:
        push: force on the base at its CoM, in world axes [N].
        press: keys of the remote control that are held down, as "L2+B".
        temperature: temperature of the motors [deg C].
        charge: charge of the battery, from 0 to 1.
        cut: whether the cable is out: nothing arrives in either direction.
        freeze: "imu", "encoders" or a joint whose values stay.
        lose: "imu", "encoders" or a joint whose values are zero.
        block: joint that is clamped where it is.
        damage: share of the samples with a wrong checksum.
        zero_crc: whether the checksum of every sample is zero.
        replay: share of the samples that are followed by one of half a second before.
        garbage: rate of additional samples with a wrong checksum [Hz].
    """

    push: tuple[float, float, float] = (0.0, 0.0, 0.0)
    press: str = ""
    temperature: float = 40.0
    charge: float = 0.8
    cut: bool = False
    freeze: str = ""
    lose: str = ""
    block: str = ""
    damage: float = 0.0
    zero_crc: bool = False
    replay: float = 0.0
    garbage: float = 0.0


_SOUND = ActiveFaults()
_NAMES = tuple(field.name for field in fields(ActiveFaults))


class FaultLines:
    """Faults as they come on standard input, each begun and ended at its moment.

    Standard input is not read where it is a terminal: a job in the background would be stopped.

    Args:
        robot: model of the simulated robot.
        say: function that logs what begins and ends.

    Attributes:
        active: faults that act now.
    """

    def __init__(self, robot: RobotModel, say: Callable[..., None]) -> None:
        self._robot, self._say = robot, say
        self.active = ActiveFaults()
        self._input: int | None = None if sys.stdin is None or sys.stdin.closed or _terminal() else 0
        self._text = b""
        self._waiting: list[dict[str, Any]] = []
        self._ends: list[tuple[float, str]] = []

    def update(self, now: float, since_command: float, lifted: bool) -> None:
        """Begin and end what is due.

        Args:
            now: robot time [s].
            since_command: robot time since the first command [s]; negative before.
            lifted: whether feet are off the floor.
        """
        self._waiting += self._lines()
        for name in [name for end, name in self._ends if now >= end]:
            self._begin(name, getattr(_SOUND, name))
        self._ends = [(end, name) for end, name in self._ends if now < end]
        for line in list(self._waiting):
            if since_command < line.get("after", -np.inf) or (line.get("when") == "lift" and not lifted):
                continue
            self._waiting.remove(line)
            for name in set(line) & set(_NAMES):
                self._begin(name, line[name])
                if "for" in line:
                    self._ends.append((now + float(line["for"]), name))

    def _begin(self, name: str, value: Any) -> None:
        setattr(self.active, name, value)
        self._say(fault=name, value=value)

    def _lines(self) -> list[dict[str, Any]]:
        """New lines; one that cannot be used ends the emulator, so that no test passes without its fault."""
        if self._input is None or not select.select([self._input], [], [], 0)[0]:
            return []
        data = os.read(self._input, 1 << 16)
        if not data:
            self._input = None
        *lines, self._text = (self._text + data).split(b"\n")
        return [self._checked(json.loads(line)) for line in lines if line.strip()]

    def _checked(self, line: dict[str, Any]) -> dict[str, Any]:
        if unknown := set(line) - {*_NAMES, "for", "after", "when"}:
            raise ValueError(f"{sorted(unknown)} in {line}: faults are {', '.join(_NAMES)}")
        for name in ("freeze", "lose", "block"):
            if line.get(name, "") not in ("", "imu", "encoders", *self._robot.joint_names):
                raise ValueError(f"{name} is {line[name]!r}; it is imu, encoders or a joint")
        if wrong := {key for key in line.get("press", "").split("+") if key} - set(KEYS):
            raise ValueError(f"press: {sorted(wrong)} are not keys; keys are {', '.join(KEYS)}")
        return line


class FaultyBody:
    """What faults make of the motors and the sensors.

    Args:
        robot: model of the simulated robot.
        gains: kp [Nm/rad] and kd [Nm s/rad] of commands that have none.
    """

    def __init__(self, robot: RobotModel, gains: tuple[float, float]) -> None:
        self._robot = robot
        self._kp, self._kd = (np.full(len(robot.joint_names), gain) for gain in gains)
        self._held: RobotState | None = None
        self._meant: JointCommand | None = None

    def moved(self, command: JointCommand, faults: ActiveFaults, state: RobotState) -> JointCommand:
        """Return the command that the joints follow: a blocked joint stays."""
        if not (faults.block or faults.freeze):
            self._held = None
        elif self._held is None:
            self._held = state
        self._meant = command
        if not faults.block or self._held is None:
            return command
        joint = self._robot.joint_names.index(faults.block)
        kp = (self._kp if command.kp is None else command.kp).copy()
        kd = (self._kd if command.kd is None else command.kd).copy()
        position, torque = command.position.copy(), None if command.torque is None else command.torque.copy()
        kp[joint], kd[joint] = _CLAMP * self._kp[joint], _CLAMP / 3 * self._kd[joint]
        position[joint] = self._held.joint_position[joint]
        if torque is not None:
            torque[joint] = 0.0
        return replace(command, position=position, torque=torque, kp=kp, kd=kd)

    def sensed(self, state: RobotState, faults: ActiveFaults) -> RobotState:
        """Return what the sensors report of a state, with temperatures and the battery."""
        health = Health(np.full(len(self._kp), faults.temperature), battery_charge=faults.charge)
        state = replace(state, health=health)
        if faults.block and self._meant is not None:
            state = self._straining(state, self._robot.joint_names.index(faults.block), self._meant)
        if faults.freeze and self._held is not None:
            state = self._replaced(state, faults.freeze, self._held)
        if faults.lose:
            joints, axes = np.zeros_like(state.joint_position), np.zeros(3)
            state = self._replaced(state, faults.lose, RobotState(0.0, joints, joints, joints, axes, axes))
        return state

    def _straining(self, state: RobotState, joint: int, meant: JointCommand) -> RobotState:
        """The motor of a blocked joint gives the torque that it is commanded, up to its limit."""
        if state.joint_torque is None:
            return state
        kp = self._kp if meant.kp is None else meant.kp
        torque = state.joint_torque.copy()
        wanted = kp[joint] * (meant.position[joint] - state.joint_position[joint])
        wanted += 0.0 if meant.torque is None else meant.torque[joint]
        torque[joint] = np.clip(wanted, -self._robot.effort_limit[joint], self._robot.effort_limit[joint])
        return replace(state, joint_torque=torque)

    def _replaced(self, state: RobotState, what: str, source: RobotState) -> RobotState:
        if what == "imu":
            return replace(
                state,
                angular_velocity_in_imu=source.angular_velocity_in_imu,
                acceleration_in_imu=source.acceleration_in_imu,
            )
        joints = slice(None) if what == "encoders" else self._robot.joint_names.index(what)
        position = state.joint_position.copy()
        position[joints] = source.joint_position[joints]
        velocity = None if state.joint_velocity is None else state.joint_velocity.copy()
        if velocity is not None and source.joint_velocity is not None:
            velocity[joints] = source.joint_velocity[joints]
        return replace(state, joint_position=position, joint_velocity=velocity)


class CrossedWiring:
    """Wiring errors: joints under the wrong names or signs, in commands, samples or both; an IMU turned by 90 deg about z.

    Args:
        robot: model of the simulated robot.
        wiring: error.
        of: "commands", "samples" or "both".
    """

    def __init__(self, robot: RobotModel, wiring: Wiring, of: WiringOf) -> None:
        joints = len(robot.joint_names)
        self._order, self._sign, self._turn = np.arange(joints), np.ones(joints), np.eye(3)
        if wiring in _LEG_ORDERS:
            for leg, other in zip(("FL", "FR", "RL", "RR"), _LEG_ORDERS[wiring], strict=True):
                self._order[list(robot.legs[leg].joints)] = robot.legs[other].joints
        elif wiring == "hip-signs":
            self._sign[[leg.joints[0] for leg in robot.legs.values()]] = -1.0
        elif wiring == "imu-quarter-turn":
            self._turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        self._commands, self._samples = wiring != "right" and of != "samples", wiring != "right" and of != "commands"

    def _crossed(self, vector: FloatArray | None) -> FloatArray | None:
        return None if vector is None else (self._sign * vector)[self._order]

    def commanded(self, command: JointCommand) -> JointCommand:
        """Return the command that reaches the motors; every leg order is its own inverse."""
        if not self._commands:
            return command
        position, velocity, torque = map(self._crossed, (command.position, command.velocity, command.torque))
        kp, kd = (None if each is None else each[self._order] for each in (command.kp, command.kd))
        return JointCommand(position, velocity, torque, kp, kd)  # pyright: ignore[reportArgumentType]

    def sensed(self, state: RobotState) -> RobotState:
        """Return the sample that leaves the robot."""
        if not self._samples:
            return state
        position, velocity, torque = map(
            self._crossed, (state.joint_position, state.joint_velocity, state.joint_torque)
        )
        return replace(
            state,
            joint_position=position,  # pyright: ignore[reportArgumentType]
            joint_velocity=velocity,
            joint_torque=torque,
            angular_velocity_in_imu=self._turn @ state.angular_velocity_in_imu,
            acceleration_in_imu=self._turn @ state.acceleration_in_imu,
        )


class FaultySamples:
    """What faults make of encoded samples, whose last four bytes are their checksum.

    Args:
        control_period: time between samples [s].
    """

    def __init__(self, control_period: float) -> None:
        self._period, self._count = control_period, 0
        self._past: deque[bytes] = deque(maxlen=_REPLAYED)

    def sent(self, data: bytes, faults: ActiveFaults) -> list[bytes]:
        """Return what is sent in place of a sample."""
        damaged = data[:-1] + bytes([data[-1] ^ 1])
        if faults.zero_crc:
            data = data[:-_CHECKSUM_SIZE] + bytes(_CHECKSUM_SIZE)
        samples = [damaged if self._due(faults.damage) else data]
        if self._due(faults.replay) and len(self._past) == _REPLAYED:
            samples.append(self._past[0])
        samples += [damaged] * round(faults.garbage * self._period)
        self._past.append(data)
        self._count += 1
        return samples

    def _due(self, share: float) -> bool:
        """Whether it is the turn of one of so large a share of all samples."""
        return int((self._count + 1) * share) > int(self._count * share)


def lifted(clearance: np.ndarray) -> bool:
    """Whether two feet or more are off the floor."""
    return int((clearance > _OFF_THE_FLOOR).sum()) >= 2


def _terminal() -> bool:
    try:
        return os.isatty(0)
    except OSError:
        return True
