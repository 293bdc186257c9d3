"""Log of a simulated gait."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.platform.platform import JointCommand, RobotState
from equipoise.recording.recording import CommandStream, ImuStream, JointStream, Recording
from equipoise.robot.model import RobotModel
from equipoise.simulation.simulated import SimulatedPlatform


class Gait(Protocol):
    """Commands of a walking robot."""

    def command(self, time: float, state: RobotState) -> JointCommand:
        """Return the command of a control period.

        Args:
            time: time since the beginning [s].
            state: last measured state.
        """
        ...


def logged(platform: SimulatedPlatform, robot: RobotModel, gait: Gait, duration: float) -> Recording:
    """Return the log of a walking robot, without events.

    Args:
        duration: total time [s].

    Raises:
        FallError: the simulation became unstable.
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
