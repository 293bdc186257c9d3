"""What a simulated robot would log of a gait."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.platform.platform import JointCommand, RobotState
from equipoise.recording.recording import CommandStream, ImuStream, JointStream, Recording
from equipoise.robot.model import RobotModel
from equipoise.simulation.simulated import SimulatedPlatform


class Gait(Protocol):
    """The commands of a robot that walks."""

    def command(self, time: float, state: RobotState) -> JointCommand:
        """Of a control period.

        Args:
            time: time since the beginning [s].
            state: what the sensors say.
        """
        ...


def logged(platform: SimulatedPlatform, robot: RobotModel, gait: Gait, duration: float) -> Recording:
    """What a robot that walks would log; without events.

    Args:
        duration: time of all [s].

    Raises:
        FallError: the simulation is no longer one.
    """
    states, commands = [platform.read()], list[JointCommand]()
    for period in range(round(duration / platform.control_period)):
        commands.append(gait.command(period * platform.control_period, states[-1]))
        states.append(platform.step(commands[-1]))
    kept = [k for k in range(len(commands)) if k == 0 or states[k].time > states[k - 1].time]  # lost samples repeat one

    def column(name: str) -> FloatArray:
        return np.array([getattr(states[k], name) for k in kept])

    time = column("time")
    return Recording(
        robot.joint_names,
        JointStream(time, column("joint_position"), column("joint_velocity"), column("joint_torque")),
        ImuStream(time, column("angular_velocity_in_imu"), column("acceleration_in_imu")),
        CommandStream(time, np.array([commands[k].position for k in kept])),
    )
