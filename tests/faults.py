"""Injected faults: a wrapper of a platform whose sensors, motors or connection fail at a chosen moment."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import CommunicationError
from equipoise.platform.platform import Health, JointCommand, Platform, RobotState, TiltLimit, Trajectory
from equipoise.platform.stepped import PlatformWrapper
from equipoise.platform.stepping import play_by_stepping
from equipoise.recording.recording import Recording
from equipoise.simulation.mujoco import MujocoPlatform

KINDS = (
    "drop", "delay", "repeat", "reorder", "freeze encoder", "freeze imu", "nan", "spike", "kill link", "stick joint",
    "lose torque", "overheat", "empty battery", "remote damp", "remote lie down", "outside",
)  # fmt: skip

_STIFF = 30.0  # times the usual gain, for a joint that is stuck
_FULLY = 10**9  # control periods


@dataclass(frozen=True)
class Fault:
    """Fault of a platform.

    Attributes:
        kind: "drop" (no new samples), "delay" (samples come late), "repeat" (the same sample again, as a new one),
            "reorder" (samples swapped in pairs), "freeze encoder", "freeze imu", "nan", "spike" (an encoder jumps now and
            then), "kill link", "stick joint", "lose torque", "overheat", "empty battery", "remote damp" and "remote lie down"
            (requests of the remote control), or "outside" for `act`.
        phase: of the motion in which it begins; None: at once.
        after: how long after that phase has begun [s].
        duration: how long it lasts [s]; None: for good.
        joint: which one, by its index.
        size: of a delay [s], a spike [rad], a temperature [deg C], a charge.
        act: "outside": called with True when it begins and False when it ends, as to push a simulated robot.
    """

    kind: str
    phase: str | None = None
    after: float = 0.0
    duration: float | None = None
    joint: int = 0
    size: float = 0.0
    act: Callable[[bool], None] | None = None

    def __post_init__(self) -> None:
        assert self.kind in KINDS


class Faulty(PlatformWrapper):
    """Platform with a fault.

    Args:
        platform: sound platform.
        fault: fault to inject.
        phase: function that returns the current phase, as a guard's `phase`.
        gains: kp [Nm/rad] and kd [Nm s/rad] of commands without gains.

    Attributes:
        begun: whether the fault has begun.
    """

    def __init__(self, platform: Platform, fault: Fault, phase: Callable[[], str], gains: tuple[float, float]) -> None:
        super().__init__(platform)
        self._fault, self._phase = fault, phase
        self._kp, self._kd = np.full((2, len(platform.joint_names)), np.array(gains)[:, None])
        self._waited = 0  # control periods since the phase was seen
        self._left = _FULLY if fault.duration is None else max(1, round(fault.duration / platform.control_period))
        self._seen = fault.phase is None
        self._onset: RobotState | None = None
        self._past: deque[RobotState] = deque(maxlen=1000)
        self._handed: RobotState | None = None
        self._meant: JointCommand | None = None
        self._count = 0
        self.begun = False

    def read(self) -> RobotState:
        return self._sensed(self._inner.read(), self.acting)

    def step(self, command: JointCommand) -> RobotState:
        acting = self._advance()
        if acting and self._fault.kind == "kill link":
            raise CommunicationError("the link is gone")
        if acting and self._onset is None:
            self._onset = self._inner.read()
        self._meant = command
        return self._sensed(self._inner.step(self._moved(command) if acting else command), acting)

    def play(self, trajectory: Trajectory, stop: TiltLimit | None = None) -> Recording:
        return play_by_stepping(self, trajectory, stop)

    @property
    def acting(self) -> bool:
        """Return whether the fault acts now."""
        return self.begun and self._left > 0

    def _advance(self) -> bool:
        """Count a control period; whether the fault acts in it."""
        self._seen = self._seen or self._phase() == self._fault.phase
        if self.acting:
            self._left -= 1
            if self._left == 0:
                self._act(False)
        elif self._seen and not self.begun:
            if self._waited >= round(self._fault.after / self.control_period):
                self.begun = True
                self._act(True)
            self._waited += 1
        return self.acting

    def _act(self, begins: bool) -> None:
        if self._fault.act is not None:
            self._fault.act(begins)

    def _moved(self, command: JointCommand) -> JointCommand:
        """Return the command that the motors execute."""
        if self._fault.kind not in ("stick joint", "lose torque") or self._onset is None:
            return command
        joint, stuck = self._fault.joint, self._fault.kind == "stick joint"
        position, torque = command.position.copy(), None if command.torque is None else command.torque.copy()
        kp, kd = (self._kp if command.kp is None else command.kp), (self._kd if command.kd is None else command.kd)
        kp, kd = kp.copy(), kd.copy()
        kp[joint], kd[joint] = (_STIFF * self._kp[joint], _STIFF / 3 * self._kd[joint]) if stuck else (0.0, 0.0)
        if stuck:
            position[joint] = self._onset.joint_position[joint]
        if torque is not None:
            torque[joint] = 0.0
        return replace(command, position=position, torque=torque, kp=kp, kd=kd)

    def _sensed(self, state: RobotState, acting: bool) -> RobotState:
        """Return the state that the sensors report."""
        self._past.append(state)
        seen = self._altered(state) if acting else state
        self._handed = seen
        return seen

    def _altered(self, state: RobotState) -> RobotState:
        fault, onset, self._count = self._fault, self._onset or state, self._count + 1
        if fault.kind == "drop":
            return self._handed or state
        if fault.kind == "delay":
            back = round(fault.size / self.control_period)
            return self._past[max(0, len(self._past) - 1 - back)]
        if fault.kind == "repeat":
            last = self._handed or state
            return replace(last, joint_position=last.joint_position.copy())
        if fault.kind == "reorder":
            return self._past[-2] if self._count % 2 == 0 and len(self._past) > 1 else self._past[-1]
        if fault.kind == "freeze imu":
            return replace(
                state,
                angular_velocity_in_imu=onset.angular_velocity_in_imu,
                acceleration_in_imu=onset.acceleration_in_imu,
            )
        if fault.kind == "stick joint":
            return self._straining(state)
        if fault.kind == "overheat":
            return _hot(state, fault.joint, fault.size)
        if fault.kind == "empty battery":
            return replace(state, health=replace(state.health or Health(), battery_charge=fault.size))
        if fault.kind.startswith("remote"):
            return replace(state, request=fault.kind.removeprefix("remote "))
        position = state.joint_position.copy()
        if fault.kind == "freeze encoder":
            position[fault.joint] = onset.joint_position[fault.joint]
        elif fault.kind == "nan":
            position[fault.joint] = np.nan
        elif fault.kind == "spike" and self._count % 7 == 0:
            position[fault.joint] += fault.size
        return replace(state, joint_position=position)

    def _straining(self, state: RobotState) -> RobotState:
        """Return a state in which the motor of a stuck joint gives its commanded torque."""
        if state.joint_torque is None or self._meant is None:
            return state
        joint, meant = self._fault.joint, self._meant
        torque = state.joint_torque.copy()
        kp = self._kp if meant.kp is None else meant.kp
        torque[joint] = kp[joint] * (meant.position[joint] - state.joint_position[joint])
        torque[joint] += 0.0 if meant.torque is None else meant.torque[joint]
        return replace(state, joint_torque=torque)


def push(platform: MujocoPlatform, force_in_world: FloatArray) -> None:
    """Push a simulated robot at its base from now on, in addition to its cable."""
    platform._push(force_in_world)


def grease(platform: MujocoPlatform, leg: str, friction: float) -> None:
    """Give one foot of a simulated robot another coefficient of friction."""
    model = platform._model
    foot = model.geom(f"equipoise_{leg}_foot").id
    model.geom_friction[foot, 0] = friction
    model.geom_priority[foot] = 1  # its friction counts, not the larger one of foot and floor


def _hot(state: RobotState, joint: int, temperature: float) -> RobotState:
    temperatures = np.full(len(state.joint_position), 30.0)
    temperatures[joint] = temperature
    return replace(state, health=replace(state.health or Health(), motor_temperature=temperatures))
