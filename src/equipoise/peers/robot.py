"""A simulated robot in real time, with what a real one has between its wire and its joints: motor boards with a watchdog."""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass
from typing import Annotated, Literal, Protocol, TextIO

import numpy as np
from tyro.conf import arg

from equipoise.platform.platform import JointCommand, RobotState
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance
from equipoise.simulation.effects import Noise, read_effects, read_names
from equipoise.simulation.simulation import Simulation, simulate

_SILENCE = 0.1  # [s] without a command after which the motor boards damp
_DAMPING = 1.0  # of the model's own kd, when they do
_LOST = 10  # control periods behind after which real time begins anew

Mode = Literal["own stance", "commanded", "damped", "released", "silence"]


class Wire(Protocol):
    """The robot's side of a protocol."""

    def commands(self) -> list[JointCommand]:
        """Commands that arrived since the last call, in order, joint vectors in the model's order; never waits."""
        ...

    def publish(self, state: RobotState, sequence: int) -> None:
        """Send a sample; `sequence` counts them from zero."""
        ...

    def close(self) -> None: ...


@dataclass(frozen=True)
class PeerSettings:
    """What robot the peer simulates, as the flags of `calibrate` say it.

    Attributes:
        noise: preset of effects.
        effects: effects besides, or of another size, as springs=3000,cable.
        without: effects that are left out, as springs,cable.
        payload: payload as MASS,X,Y,Z, or None.
        seed: seed of everything drawn.
        start: state at the start, "standing" (it holds its own stance until the first command comes) or "lying" (it is
            limp until then).
        duration: time after which it ends by itself [s].
    """

    noise: Noise = "realistic"
    effects: Annotated[tuple[str, ...], arg(name="with")] = ()
    without: tuple[str, ...] = ()
    payload: str | None = None
    seed: int = 0
    start: Literal["standing", "lying"] = "standing"
    duration: float = 3600.0


class PeerRobot:
    """The simulated robot, and what it saw: one JSON object a line, as {"time": 1.204, "mode": "damped"}.

    With a mode it says how many commands it got until then that were stiff, and how many that were not.
    """

    def __init__(self, robot: RobotModel, settings: PeerSettings, log: TextIO = sys.stdout) -> None:
        self.robot, self.settings = robot, settings
        self._log = log
        self._simulation: Simulation = simulate(
            robot, settings.noise, settings.payload, settings.seed, settings.start,
            effects=read_effects(settings.effects), without=read_names(settings.without),
        )  # fmt: skip
        self._platform = self._simulation.platform
        stance = nominal_stance(robot)
        self._kd = np.full(len(robot.joint_names), robot.gains(stance.hip_height)[1])
        self._state = self._platform.read()
        self._hold = stance.joint_position  # not what it sagged to: it would sag again
        self._command: JointCommand | None = None
        self._heard = -np.inf
        self._mode: Mode | None = None
        self._stiff = self._limp = 0

    @property
    def control_period(self) -> float:
        return self._platform.control_period

    def hear(self, command: JointCommand) -> None:
        """A command that arrived."""
        limp = command.kp is not None and not command.kp.any()
        self._stiff, self._limp = self._stiff + (not limp), self._limp + limp
        self._command, self._heard = command, self._state.time

    def step(self) -> RobotState:
        """One control period."""
        self._state = self._platform.step(self._in_force())
        return self._state

    def serve(self, wire: Wire) -> None:
        """Run in real time until the settings' duration is over or Ctrl-C; says {"ready": true} when it listens."""
        self.say(ready=True)
        begin = deadline = time.monotonic()
        sequence = 0
        try:
            while time.monotonic() - begin < self.settings.duration:
                for command in wire.commands():
                    self.hear(command)
                wire.publish(self.step(), sequence)
                sequence += 1
                deadline += self.control_period
                left = deadline - time.monotonic()
                if left > 0:
                    time.sleep(left)
                elif -left > _LOST * self.control_period:
                    self.say(behind=round(-left, 4))
                    deadline = time.monotonic()
        except KeyboardInterrupt:
            pass
        finally:
            self.say(ended=True, stiff=self._stiff, limp=self._limp)
            wire.close()
            self._platform.close()

    def say(self, **what: object) -> None:
        """Append to the log, at one go: Ctrl-C must not part a line from its end."""
        self._log.write(json.dumps({"time": round(self._state.time, 4), **what}) + "\n")
        self._log.flush()

    def _in_force(self) -> JointCommand:
        """What the motor boards do now."""
        zeros = np.zeros_like(self._hold)
        limp = JointCommand(self._hold, kp=zeros, kd=_DAMPING * self._kd)
        command, mode = self._command, "commanded"
        if command is None:
            lying = self.settings.start == "lying"
            command, mode = (limp if lying else JointCommand(self._hold)), "own stance"
        elif self._state.time - self._heard > _SILENCE:
            command, mode = limp, "silence"
        elif command.kp is not None and not command.kp.any():
            mode = "damped" if command.kd is not None and command.kd.any() else "released"
        self._enter(mode)  # pyright: ignore[reportArgumentType]
        return command

    def _enter(self, mode: Mode) -> None:
        if mode != self._mode:
            self._mode = mode
            self.say(mode=mode, stiff=self._stiff, limp=self._limp)
