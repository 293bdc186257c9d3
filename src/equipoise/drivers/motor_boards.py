"""Measurement of the motor boards' behaviour when commands stop, on a hanging robot. Only damping is commanded."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

import numpy as np

from equipoise.drivers.hardware import RobotConnection
from equipoise.platform.platform import JointCommand, RobotState
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance

_SILENCES = (0.1, 1.0, 10.0)  # [s] without a command
_DAMPING = 0.2  # of the robot's own damping gain, while it is commanded
_AS_FOUND, _DAMPED = 2.0, 2.0  # [s] of samples before the first command, and of damping before each silence
_MOVING = 0.2  # [rad/s] of a joint whose damping can be measured
_LEAST = 20  # samples of moving joints for a damping estimate


@dataclass(frozen=True)
class HangingPhase:
    """Samples of one phase of the measurement.

    Attributes:
        name: name of the phase.
        duration: duration [s].
        commanded_damping: commanded damping [Nm s/rad]; None: no command was sent.
        samples: number of samples with a correct checksum.
        rejected: number of rejected samples.
        longest_gap: longest time between two samples [s].
        largest_torque: largest joint torque that a motor reported [Nm]; None: not reported.
        largest_speed: largest joint speed [rad/s]; None: not reported.
        damping: torque against the motion over speed, of moving joints in the second half [Nm s/rad]; None: they did not move.
        motor_modes: modes that motors reported at its end; empty: not reported.
        lost: lost messages between the robot's computer and its motors; None: not reported.
        temperature: highest motor temperature [deg C]; None: not reported.
    """

    name: str
    duration: float
    commanded_damping: float | None
    samples: int
    rejected: int
    longest_gap: float
    largest_torque: float | None
    largest_speed: float | None
    damping: float | None
    motor_modes: tuple[int, ...]
    lost: int | None
    temperature: float | None


def measure_hanging(connection: RobotConnection, robot: RobotModel) -> Generator[HangingPhase, None, None]:
    """Yield the phases: as found, then damped and silent for each silence, and damped at the end.

    Args:
        connection: connection to a robot that hangs with its legs free; the first command takes over the motors.
        robot: model of the robot.

    Raises:
        CommunicationError: no more samples arrive.
    """
    zeros = np.zeros(len(robot.joint_names))
    kd = _DAMPING * robot.gains(nominal_stance(robot).hip_height)[1]
    damping = JointCommand.damping(zeros, kd)
    yield _phase(connection, "as found", _AS_FOUND, None, kd)
    for silence in _SILENCES:
        yield _phase(connection, "damped", _DAMPED, damping, kd)
        yield _phase(connection, f"silent for {silence:g} s", silence, None, kd)
    yield _phase(connection, "damped", _DAMPED, damping, kd)


def _phase(
    connection: RobotConnection, name: str, duration: float, command: JointCommand | None, kd: float
) -> HangingPhase:
    states: list[RobotState] = []
    rejected, lost = connection.rejected, sum(_report(connection).get("lost", ()))
    if command is not None:
        connection.send(command)  # the first takes seconds
    until = time.monotonic() + duration
    while time.monotonic() < until:
        if command is not None:
            connection.send(command)
        states += connection.receive()
        time.sleep(connection.control_period)
    report, times = _report(connection), [state.received for state in states if state.received is not None]
    heat = [state.health.motor_temperature for state in states if state.health is not None]
    return HangingPhase(
        name,
        duration,
        None if command is None else kd,
        len(states),
        connection.rejected - rejected,
        float(np.diff(times).max()) if len(times) > 1 else duration,
        _largest([state.joint_torque for state in states]),
        _largest([state.joint_velocity for state in states]),
        _damping(states[len(states) // 2 :]),
        tuple(sorted({*report.get("mode", ())})),
        sum(report["lost"]) - lost if "lost" in report else None,
        _largest(heat),
    )


def _report(connection: RobotConnection) -> dict[str, list[int]]:
    """Return the newest "mode" of each motor and its count of "lost" messages, if the connection has a `motor_report`."""
    report: Callable[[], dict[str, list[int]]] = getattr(connection, "motor_report", dict)
    return report()


def _largest(values: Sequence[np.ndarray | None]) -> float | None:
    reported = [value for value in values if value is not None]
    return float(np.abs(reported).max()) if reported else None


def _damping(states: Sequence[RobotState]) -> float | None:
    """Return the least-squares damping; None: too few samples of moving joints, or no reported torques."""
    pairs = [
        (s.joint_velocity, s.joint_torque)
        for s in states
        if s.joint_velocity is not None and s.joint_torque is not None
    ]
    speed, torque = np.array(pairs).reshape(-1, 2, len(pairs[0][0])).swapaxes(0, 1) if pairs else np.zeros((2, 0, 1))
    moving = np.abs(speed) > _MOVING
    if moving.sum() < _LEAST:
        return None
    return float(-(speed[moving] @ torque[moving]) / (speed[moving] @ speed[moving]))
