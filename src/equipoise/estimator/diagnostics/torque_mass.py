"""Comparison of the given mass with the mass that the joint torques carry: at rest before the run, and from the estimate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.equations.torque_balance import TorqueBalance
from equipoise.estimator.prior_runs.prior_run import PriorRun
from equipoise.estimator.problem import Posterior
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.result.mass_comparison import MassComparison
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance
from equipoise.robot.statics import carried_mass

# Largest difference of the two masses. Motors of one type share an error of their torque constants of 5 %, and of 30 to 50 %
# on a vendor's bench: a difference is a question to the user, not an error.
_DIFFERENCE = 0.15
_DIFFERENCE_CALIBRATED = 0.05  # with a prior run's torque constants: at rest they were 3.1 % off at most (stress)
_STDS = 2.0  # standard deviations of the given mass, and of a prior run's torque constants

Scale = tuple[float, float]
"""Mass of the whole robot from a scale, and its standard deviation [kg]."""


def compare_at_rest(
    robot: RobotModel, stance: Stance, scale: Scale, rests: Sequence[Recording], prior_run: PriorRun | None
) -> MassComparison | None:
    """Compare a given mass with the joint torques at rest; None without joint torques.

    Args:
        rests: recordings of the robot at rest on four feet, reached from opposite directions: joint friction cancels.
        prior_run: prior run whose torque constants are used.
    """
    gains, limit = torque_constants(robot, stance, prior_run)
    carried: list[float] = []
    for recording in rests:
        joints = recording.phase(Phase.REST).joints
        if joints.torque is None:
            return None
        torque = gains * joints.torque.mean(axis=0)
        carried.append(carried_mass(robot, joints.position.mean(axis=0), torque))
    return _compared(scale, float(np.mean(carried)), limit, prior_run)


def compare_estimate(posterior: Posterior, scale: Scale | None, prior_run: PriorRun | None) -> MassComparison | None:
    """Compare a given mass with the joint torques of a whole run; None without a given mass or joint torques.

    The estimated mass is converted from estimated to reported torque constants, or to those of the prior run.
    """
    if scale is None or posterior.problem.equation(TorqueBalance) is None:
        return None
    unknowns = posterior.unknowns
    values = unknowns.values(posterior.x)
    gain = 1 + float(values["torque_gain_common"].mean() + values["torque_gain"].mean())
    gains, limit = torque_constants(unknowns.robot, unknowns.stance, prior_run)
    return _compared(scale, posterior.robot_body.mass * float(gains.mean()) / gain, limit, prior_run)


def assumed_mass(scale: Scale | None, masses: MassComparison | None) -> tuple[str, ...]:
    """Return the assumption of a run with a given mass; empty without one."""
    if scale is None:
        return ()
    mass, std = scale
    assumed = (
        f"the given mass of {mass:g} kg is right (standard deviation {std:.2g} kg): mass and inertia scale with it"
    )
    return (assumed if masses is not None else f"{assumed}, and there are no joint torques to compare it with",)


def torque_constants(robot: RobotModel, stance: Stance, prior_run: PriorRun | None) -> tuple[FloatArray, float]:
    """Return the (nj,) true over reported torques, one without a prior run, and the largest difference of masses."""
    if prior_run is None:
        return np.ones(len(robot.joint_names)), _DIFFERENCE
    gains, std = prior_run.torque_gains(robot, stance)
    return gains, float(np.clip(_STDS * std, _DIFFERENCE_CALIBRATED, _DIFFERENCE))


def _compared(scale: Scale, carried: float, limit: float, prior_run: PriorRun | None) -> MassComparison:
    mass, std = scale
    limit = max(limit, _STDS * std / mass)
    return MassComparison(mass, carried, limit, None if prior_run is None else prior_run.name)
