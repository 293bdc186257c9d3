"""Soft start: transition from the robot's joint positions to the first command, in one second."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.platform.platform import JointCommand, RobotState
from equipoise.platform.ramp import smooth_step

SOFT_START = 1.0  # [s]


def soft_start(
    first: JointCommand,
    state: RobotState,
    own_gains: tuple[FloatArray, FloatArray] | None,
    limp: bool,
    period: float,
    allowed: FloatArray,
) -> Generator[JointCommand]:
    """Yield commands that lead smoothly to the first one.

    A standing robot begins at full stiffness at its joint positions. Its present torques are kept as far as the first command
    requires them. A limp robot's stiffness increases gradually.

    Args:
        first: command that is sent next.
        state: state of the robot.
        own_gains: (nj,) kp [Nm/rad] and kd [Nm s/rad] of commands without gains; None: gains cannot be sent.
        limp: whether the joints carry no load yet.
        period: control period [s].
        allowed: (2, nj) lower and upper joint limits [rad]; targets stay within them, also if limp joints are beyond.
    """
    here, now = np.clip(state.joint_position, *allowed), _torque_now(first, state, limp)
    for share in smooth_step(round(SOFT_START / period)):
        position = here + share * (first.position - here)
        torque = None if first.torque is None else now + share * (first.torque - now)
        command = replace(first, position=position, velocity=None, torque=torque)
        yield command if own_gains is None or not limp else softened(command, own_gains, share)


def _torque_now(first: JointCommand, state: RobotState, limp: bool) -> FloatArray:
    """Return the (nj,) initial feed-forward [Nm]: measured torques, limited to between zero and the first command's.

    The limits keep a sensor with a wrong sign or scale harmless.
    """
    zeros = np.zeros_like(first.position)
    if first.torque is None or state.joint_torque is None or limp:
        return zeros
    return np.median([zeros, state.joint_torque, first.torque], axis=0)


def softened(command: JointCommand, own_gains: tuple[FloatArray, FloatArray], share: float) -> JointCommand:
    """Return a command with a share of its stiffness and all of its damping."""
    kp, kd = (own if sent is None else sent for own, sent in zip(own_gains, (command.kp, command.kd), strict=True))
    return replace(command, kp=share * kp, kd=kd)
