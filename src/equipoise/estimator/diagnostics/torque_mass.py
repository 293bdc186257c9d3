"""The given mass against the mass that the joint torques carry: before the run, at rest, and after it, by the estimate."""

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

# Largest difference of the two masses. Motors of one type have torque constants that are off by 5 % in common, and on a
# vendor's bench by 30 to 50 %: a difference is a question and no refusal.
_DIFFERENCE = 0.15
_DIFFERENCE_KNOWN = 0.05  # with an earlier run's torque constants: at rest they were 3.1 % off at the most (stress)
_DEVIATIONS = 2.0  # standard deviations of the given mass, and of an earlier run's torque constants

Scale = tuple[float, float]
"""Mass of the whole robot from a scale, and its standard deviation [kg]."""


def compare_at_rest(
    robot: RobotModel, stance: Stance, scale: Scale, rests: Sequence[Recording], known: PriorRun | None
) -> MassComparison | None:
    """Compare a given mass with the joint torques at rest; None: there are no joint torques.

    Args:
        rests: recordings of the robot at rest on four feet, reached from opposite directions: joint friction cancels.
        known: earlier run whose torque constants are used.
    """
    gains, limit = _torque_constants(robot, stance, known)
    carried: list[float] = []
    for recording in rests:
        joints = recording.phase(Phase.REST).joints
        if joints.torque is None:
            return None
        torque = gains * joints.torque.mean(axis=0)
        carried.append(carried_mass(robot, joints.position.mean(axis=0), torque))
    return _compared(scale, float(np.mean(carried)), limit, known)


def compare_estimate(posterior: Posterior, scale: Scale | None, known: PriorRun | None) -> MassComparison | None:
    """Compare a given mass with the joint torques of a whole run; None: there is no given mass, or no joint torques.

    The estimated torque constants carry the estimated mass; those that are reported, or known, carry another one.
    """
    if scale is None or posterior.problem.equation(TorqueBalance) is None:
        return None
    unknowns = posterior.unknowns
    values = unknowns.values(posterior.x)
    gain = 1 + float(values["torque_gain_common"].mean() + values["torque_gain"].mean())
    gains, limit = _torque_constants(unknowns.robot, unknowns.stance, known)
    return _compared(scale, posterior.robot_body.mass * float(gains.mean()) / gain, limit, known)


def assumed_mass(scale: Scale | None, masses: MassComparison | None) -> tuple[str, ...]:
    """Return the assumption that a run with a given mass makes; none of a run without."""
    if scale is None:
        return ()
    mass, std = scale
    assumed = (
        f"the given mass of {mass:g} kg is right (standard deviation {std:.2g} kg): mass and inertia scale with it"
    )
    return (assumed if masses is not None else f"{assumed}, and there are no joint torques to compare it with",)


def _torque_constants(robot: RobotModel, stance: Stance, known: PriorRun | None) -> tuple[FloatArray, float]:
    """Return (nj,) true over reported torques as far as they are known, and the largest difference of masses with them."""
    if known is None:
        return np.ones(len(robot.joint_names)), _DIFFERENCE
    gains, std = known.torque_gains(robot, stance)
    return gains, float(np.clip(_DEVIATIONS * std, _DIFFERENCE_KNOWN, _DIFFERENCE))


def _compared(scale: Scale, carried: float, limit: float, known: PriorRun | None) -> MassComparison:
    mass, std = scale
    limit = max(limit, _DEVIATIONS * std / mass)
    return MassComparison(mass, carried, limit, None if known is None else known.name)
