"""Simulated robot in real time, with motor boards and their watchdog between its wire and its joints."""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass
from typing import Literal, Protocol, TextIO

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.lab.emulators.faults import (
    ActiveFaults,
    CrossedWiring,
    FaultLines,
    FaultyBody,
    Wiring,
    WiringOf,
    lifted,
)
from equipoise.platform.platform import JointCommand, RobotState
from equipoise.platform.realtime import claim_priority
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance
from equipoise.simulation.effects import Noise, read_effects, read_names
from equipoise.simulation.simulation import Simulation, simulate

_SILENCE = 0.1  # [s] without a command until the motor boards damp
_DAMPING = 1.0  # of the model's kd
_LOST = 10  # control periods of delay until real time is reset
_TRACE = 0.1  # [s] between lines of the trace

Mode = Literal["own stance", "commanded", "damped", "released", "silence"]


class Wire(Protocol):
    """Robot side of a protocol."""

    def commands(self) -> list[JointCommand]:
        """Return the commands since the last call without waiting, in order, joint vectors in the model's order."""
        ...

    def publish(self, state: RobotState, faults: ActiveFaults) -> None:
        """Send a sample, with the faults of the remote control and of the wire."""
        ...

    def close(self) -> None: ...


@dataclass(frozen=True)
class EmulatorSettings:
    """Simulated robot of an emulator, with the flags of `calibrate`.

    Attributes:
        robot: quadruped to emulate: a name, or a URDF or MJCF file.
        sim_preset: preset of effects.
        enable_effect: additional effects or other sizes, for example springs=3000,cable.
        disable_effect: effects to disable, for example springs,cable.
        payload: payload as MASS,X,Y,Z, or None.
        seed: seed of everything drawn.
        start: state until the first command: "standing" in its own stance, or "lying" without torques.
        duration: time until the emulator ends [s].
        wiring: wiring error from the start.
        wiring_of: part with the wiring error.
        trace: log the motion of the base and the largest joint torque every 0.1 s, not only with a mode.
    """

    robot: str = "unitree_a1"
    sim_preset: Noise = "realistic"
    enable_effect: tuple[str, ...] = ()
    disable_effect: tuple[str, ...] = ()
    payload: str | None = None
    seed: int = 0
    start: Literal["standing", "lying"] = "standing"
    duration: float = 3600.0
    wiring: Wiring = "right"
    wiring_of: WiringOf = "both"
    trace: bool = False


class EmulatedRobot:
    """Simulated robot and its log of one JSON object per line, for example {"time": 1.204, "mode": "damped"}.

    A line with a mode also has the numbers of stiff and limp commands so far, the "tilt" of the base [deg] and the
    "height" of the CoM above the floor [m]. Its largest vertical "speed", upward [m/s], and the largest joint "torque" [Nm]
    with its "joint" are those since the last such line.
    """

    def __init__(self, robot: RobotModel, settings: EmulatorSettings, log_file: TextIO = sys.stdout) -> None:
        self.robot, self.settings = robot, settings
        self._log_file = log_file
        self._simulation: Simulation = simulate(
            robot, settings.sim_preset, settings.payload, settings.seed, settings.start,
            effects=read_effects(settings.enable_effect), disabled_effects=read_names(settings.disable_effect),
        )  # fmt: skip
        self._platform = self._simulation.platform
        stance = nominal_stance(robot)
        gains = robot.gains(stance.hip_height)
        self._kd = np.full(len(robot.joint_names), gains[1])
        self._state = self._platform.read()
        self._hold = stance.joint_position  # not the sagged position, which would sag again
        self._command: JointCommand | None = None
        self._commanded_since: float | None = None
        self._last_received = -np.inf
        self._mode: Mode | None = None
        self._stiff = self._limp = 0
        self._lines, self._body = FaultLines(robot, self.log), FaultyBody(robot, gains)
        self._wiring = CrossedWiring(robot, settings.wiring, settings.wiring_of)
        truth = self._simulation.ground_truth()
        self._com_height, self._speed, self._tilt = float(truth.com[2]), 0.0, float(np.degrees(truth.tilt))
        self._largest: FloatArray = np.zeros(len(robot.joint_names))
        self._traced = -np.inf

    @property
    def control_period(self) -> float:
        return self._platform.control_period

    def receive(self, command: JointCommand) -> None:
        """Process a command from the wire."""
        limp = command.kp is not None and not command.kp.any()
        self._stiff, self._limp = self._stiff + (not limp), self._limp + limp
        self._command, self._last_received = self._wiring.commanded(command), self._state.time
        if self._commanded_since is None:
            self._commanded_since = self._state.time

    def step(self) -> RobotState:
        """Simulate one control period and return the sample for the wire."""
        faults = self._lines.active
        if self._simulation.push is not None:
            self._simulation.push(np.array(faults.push))
        self._state = self._platform.step(self._body.moved(self._active_command(), faults, self._state))
        sensed = self._body.sensed(self._state, faults)
        self._record_motion(sensed)
        return self._wiring.sensed(sensed)

    def serve(self, wire: Wire) -> None:
        """Run in real time until the settings' duration is over or Ctrl-C, and log {"ready": true} at the start."""
        claim_priority()  # a robot keeps its timing under any load of this computer
        self.log(ready=True)
        begin = deadline = time.monotonic()
        try:
            while time.monotonic() - begin < self.settings.duration:
                commands, cut = wire.commands(), self._lines.active.cut
                for command in [] if cut else commands:
                    self.receive(command)
                state = self.step()
                if not cut:
                    wire.publish(state, self._lines.active)
                deadline += self.control_period
                left = deadline - time.monotonic()
                if left > 0:
                    time.sleep(left)
                elif -left > _LOST * self.control_period:
                    self.log(behind=round(-left, 4))
                    deadline = time.monotonic()
        except KeyboardInterrupt:
            pass
        finally:
            self.log(ended=True, stiff=self._stiff, limp=self._limp)
            wire.close()
            self._platform.close()

    def log(self, **entry: object) -> None:
        """Append a line to the log in one write, so that Ctrl-C cannot split it."""
        self._log_file.write(json.dumps({"time": round(self._state.time, 4), **entry}) + "\n")
        self._log_file.flush()

    def _record_motion(self, sensed: RobotState) -> None:
        """Record the true motion, and begin the faults that are due."""
        truth, before = self._simulation.ground_truth(), self._com_height
        self._com_height, self._tilt = float(truth.com[2]), float(np.degrees(truth.tilt))
        self._speed = max(self._speed, (self._com_height - before) / self.control_period, key=abs)
        if sensed.joint_torque is not None:
            self._largest = np.maximum(self._largest, np.abs(sensed.joint_torque))
        now = self._state.time
        if self.settings.trace and now - self._traced >= _TRACE:
            self._traced = now
            self.log(**self._motion())
        since = -np.inf if self._commanded_since is None else now - self._commanded_since
        self._lines.update(now, since, lifted(truth.clearance))

    def _motion(self) -> dict[str, object]:
        """Return the motion since the last call."""
        joint, largest, speed = int(np.argmax(self._largest)), self._largest, self._speed
        self._largest, self._speed = np.zeros_like(largest), 0.0
        return {
            "tilt": round(self._tilt, 2),
            "height": round(self._com_height, 4),
            "speed": round(speed, 4),
            "torque": round(float(largest[joint]), 2),
            "joint": self.robot.joint_names[joint],
        }

    def _active_command(self) -> JointCommand:
        """Return the command that the motor boards execute."""
        limp = JointCommand.damping(self._hold, _DAMPING * self._kd)
        command, mode = self._command, "commanded"
        if command is None:
            lying = self.settings.start == "lying"
            command, mode = (limp if lying else JointCommand(self._hold)), "own stance"
        elif self._state.time - self._last_received > _SILENCE:
            command, mode = limp, "silence"
        elif command.kp is not None and not command.kp.any():
            mode = "damped" if command.kd is not None and command.kd.any() else "released"
        if mode != self._mode:
            self._mode = mode
            self.log(mode=mode, stiff=self._stiff, limp=self._limp, **self._motion())
        return command
