"""Faults of a simulated robot: pushes, sensor failures, damaged samples, a disconnected cable, crossed wiring.

A fault is a line of JSON on the emulator's standard input, for example

    {"push": [0, 100, 0], "for": 0.3, "when": "lift"}
    {"press": "L2+B", "after": 12}

"after" delays the fault by a robot time since the first command [s]. "when": "lift" delays it until two feet are off the
floor. Without either, it begins at once. "for" is its duration [s]; without it, the fault lasts until the value is set again.
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
_CLAMP = 30.0  # stiffness of a blocked joint over its own; damping a third of that
_REPLAYED = 250  # samples from a sample to its repetition
_OFF_THE_FLOOR = 5e-3  # [m], least clearance of a lifted foot
_CHECKSUM_SIZE = 4  # [bytes] at the end of every sample


@dataclass
class ActiveFaults:
    """Active faults; the defaults are a robot without faults. A joint is its name.

    Attributes:
        push: force on the base at its CoM, in world axes [N].
        press: pressed keys of the remote control, for example "L2+B".
        temperature: temperature of the motors [deg C].
        charge: charge of the battery, from 0 to 1.
        cut: true for a disconnected cable, in both directions.
        freeze: "imu", "encoders" or a joint with constant values.
        lose: "imu", "encoders" or a joint with zero values.
        block: joint that is clamped at its position.
        damage: share of samples with a wrong checksum.
        zero_crc: true for zero checksums in all samples.
        replay: share of samples followed by a repeated one from half a second before.
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


_NO_FAULTS = ActiveFaults()
_NAMES = tuple(field.name for field in fields(ActiveFaults))


class FaultLines:
    """Faults from standard input, with their beginnings and ends.

    Standard input is not read if it is a terminal, because that would stop a background job.

    Args:
        robot: model of the simulated robot.
        log: function that logs beginnings and ends.

    Attributes:
        active: faults that are active.
    """

    def __init__(self, robot: RobotModel, log: Callable[..., None]) -> None:
        self._robot, self._log = robot, log
        self.active = ActiveFaults()
        self._input: int | None = None if sys.stdin is None or sys.stdin.closed or os.isatty(0) else 0
        self._text = b""
        self._waiting: list[dict[str, Any]] = []
        self._ends: list[tuple[float, str]] = []

    def update(self, now: float, since_command: float, lifted: bool) -> None:
        """Begin and end the faults that are due.

        Args:
            now: robot time [s].
            since_command: robot time since the first command [s]; negative before it.
            lifted: true if feet are off the floor.
        """
        self._waiting += self._lines()
        for name in [name for end, name in self._ends if now >= end]:
            self._begin(name, getattr(_NO_FAULTS, name))
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
        self._log(fault=name, value=value)

    def _lines(self) -> list[dict[str, Any]]:
        """Return new lines. An invalid line ends the emulator, so that no test passes without its fault."""
        if self._input is None or not select.select([self._input], [], [], 0)[0]:
            return []
        data = os.read(self._input, 1 << 16)
        if not data:
            self._input = None
        *lines, self._text = (self._text + data).split(b"\n")
        return [self._checked(json.loads(line)) for line in lines if line.strip()]

    def _checked(self, line: dict[str, Any]) -> dict[str, Any]:
        if unknown := set(line) - {*_NAMES, "for", "after", "when"}:
            raise ValueError(f"unknown {sorted(unknown)} in {line}; faults are {', '.join(_NAMES)}")
        for name in ("freeze", "lose", "block"):
            if line.get(name, "") not in ("", "imu", "encoders", *self._robot.joint_names):
                raise ValueError(f"{name} is {line[name]!r}; it must be imu, encoders or a joint")
        if wrong := {key for key in line.get("press", "").split("+") if key} - set(KEYS):
            raise ValueError(f"press has unknown keys {sorted(wrong)}; keys are {', '.join(KEYS)}")
        return line


class FaultyBody:
    """Motors and sensors with faults.

    Args:
        robot: model of the simulated robot.
        gains: kp [Nm/rad] and kd [Nm s/rad] of commands without gains.
    """

    def __init__(self, robot: RobotModel, gains: tuple[float, float]) -> None:
        self._robot = robot
        self._kp, self._kd = (np.full(len(robot.joint_names), gain) for gain in gains)
        self._held: RobotState | None = None
        self._commanded: JointCommand | None = None

    def moved(self, command: JointCommand, faults: ActiveFaults, state: RobotState) -> JointCommand:
        """Return the command that the joints follow, with a blocked joint at its position."""
        if not (faults.block or faults.freeze):
            self._held = None
        elif self._held is None:
            self._held = state
        self._commanded = command
        if not faults.block or self._held is None:
            return command
        joint = self._robot.joint_names.index(faults.block)
        position, velocity, torque, kp, kd = command.table(self._kp, self._kd)
        position[joint], torque[joint] = self._held.joint_position[joint], 0.0
        kp[joint], kd[joint] = _CLAMP * self._kp[joint], _CLAMP / 3 * self._kd[joint]
        return JointCommand(position, velocity, torque, kp, kd)

    def sensed(self, state: RobotState, faults: ActiveFaults) -> RobotState:
        """Return the measured state, with temperatures and battery."""
        health = Health(np.full(len(self._kp), faults.temperature), battery_charge=faults.charge)
        state = replace(state, health=health)
        if faults.block and self._commanded is not None:
            state = self._with_blocked_torque(state, self._robot.joint_names.index(faults.block), self._commanded)
        if faults.freeze and self._held is not None:
            state = self._replaced(state, faults.freeze, self._held)
        if faults.lose:
            joints, axes = np.zeros_like(state.joint_position), np.zeros(3)
            state = self._replaced(state, faults.lose, RobotState(0.0, joints, joints, joints, axes, axes))
        return state

    def _with_blocked_torque(self, state: RobotState, joint: int, commanded: JointCommand) -> RobotState:
        """Return the state with the commanded torque of a blocked joint, up to its limit."""
        if state.joint_torque is None:
            return state
        position, _, feed_forward, kp, _ = commanded.table(self._kp, self._kd)[:, joint]
        torque, effort = state.joint_torque.copy(), kp * (position - state.joint_position[joint]) + feed_forward
        torque[joint] = np.clip(effort, -self._robot.effort_limit[joint], self._robot.effort_limit[joint])
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
    """Wiring errors: wrong names or signs of joints in commands, samples or both; an IMU rotated by 90 deg about z.

    Args:
        robot: model of the simulated robot.
        wiring: wiring error.
        of: part with the error, "commands", "samples" or "both".
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
    """Encoded samples with faults; the last four bytes of a sample are its checksum.

    Args:
        control_period: time between samples [s].
    """

    def __init__(self, control_period: float) -> None:
        self._period, self._count = control_period, 0
        self._past: deque[bytes] = deque(maxlen=_REPLAYED)

    def sent(self, data: bytes, faults: ActiveFaults) -> list[bytes]:
        """Return the samples to send in place of one."""
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
        """Return true for evenly spaced samples with the given share of all."""
        return int((self._count + 1) * share) > int(self._count * share)


def lifted(clearance: np.ndarray) -> bool:
    """Return true if at least two feet are off the floor."""
    return int((clearance > _OFF_THE_FLOOR).sum()) >= 2
