"""Log of a simulated gait."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.platform.platform import JointCommand, RobotState
from equipoise.platform.stepping import recording_of
from equipoise.recording.recording import Recording
from equipoise.robot.model import RobotModel
from equipoise.simulation.simulated import SimulatedPlatform


def logged(
    platform: SimulatedPlatform,
    robot: RobotModel,
    command: Callable[[float, RobotState], JointCommand],
    duration: float,
) -> Recording:
    """Return the log of a walking robot, without events.

    Args:
        command: gait: function that returns the command for a time since the beginning [s] and the last measured state.
        duration: total time [s].

    Raises:
        FallError: the simulation became unstable.
    """
    state = platform.read()
    samples, targets = list[RobotState](), list[FloatArray]()
    for period in range(round(duration / platform.control_period)):
        commanded = command(period * platform.control_period, state)
        if not samples or state.time > samples[-1].time:  # lost samples repeat one
            samples.append(state)
            targets.append(commanded.position)
        state = platform.step(commanded)
    return recording_of(robot.joint_names, samples, np.array(targets), ())
