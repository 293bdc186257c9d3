"""The first second under command: targets, torques and gains go from where the robot is to what is first sent."""

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
    """Commands up to the first one, none of which the joints feel as a blow.

    A standing robot is taken over as it stands: at full stiffness where its joints are, with the torques that they give
    already, as far as the first command asks for them too. A limp one gets its stiffness by and by.

    Args:
        first: command that is sent next.
        state: state of the robot.
        own_gains: (nj,) kp [Nm/rad] and kd [Nm s/rad] of commands that say none; None: gains cannot be sent.
        limp: whether the joints carry nothing yet.
        period: control period [s].
        allowed: (2, nj) lower and upper joint limits [rad]; a limp robot may hang a little beyond them, and is not held there.
    """
    here, now = np.clip(state.joint_position, *allowed), _torque_now(first, state, limp)
    for share in smooth_step(round(SOFT_START / period)):
        position = here + share * (first.position - here)
        torque = None if first.torque is None else now + share * (first.torque - now)
        command = replace(first, position=position, velocity=None, torque=torque)
        yield command if own_gains is None or not limp else softened(command, own_gains, share)


def _torque_now(first: JointCommand, state: RobotState, limp: bool) -> FloatArray:
    """(nj,) feed-forward to begin with [Nm]: what a joint gives, if that is between nothing and what it is to give.

    A sensor with the wrong sign or scale can so do no more harm than none.
    """
    zeros = np.zeros_like(first.position)
    if first.torque is None or state.joint_torque is None or limp:
        return zeros
    return np.median([zeros, state.joint_torque, first.torque], axis=0)


def softened(command: JointCommand, own_gains: tuple[FloatArray, FloatArray], share: float) -> JointCommand:
    """A command with a share of its stiffness and all of its damping."""
    kp, kd = (own if said is None else said for own, said in zip(own_gains, (command.kp, command.kd), strict=True))
    return replace(command, kp=share * kp, kd=kd)
