"""Mass and planar CoM of a robot that stands still, from its joint torques."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.estimator.unknowns import Priors
from equipoise.experiments.lift import LiftSettings, come_to_rest
from equipoise.experiments.progress import Progress
from equipoise.experiments.standing_robot import StandingRobot
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.recording.trials import StandTrial
from equipoise.result.body import Body
from equipoise.result.calibration import Calibration, Trial, model_facts
from equipoise.robot.inertial import composite_parameters, nominal_inertia
from equipoise.robot.kinematics import foot_forces_from_torques, foot_positions
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance
from equipoise.robot.statics import torques_of_legs

_REST_TIME = 2.0  # [s]


def stand_still(standing: StandingRobot, stance: Stance, report: Callable[[Progress], None] | None) -> None:
    """Stand still for a while; arguments are those of `Method.run`."""
    if report is not None:
        report(Progress("standing still", 0, 1))
    motion = standing.motion().begin(StandTrial()).phase(Phase.MOVE)
    at_rest = LiftSettings(height=0.0, rest_time=_REST_TIME)
    come_to_rest(standing, motion.move_feet(stance.feet_in_base, 0.2), at_rest, "standing")
    standing.finish()


def estimate_standing(
    robot: RobotModel, recordings: Sequence[Recording], stance: Stance, settings: Mapping[str, Any]
) -> Calibration:
    """Estimate the mass from the sum of foot forces and the planar CoM from the centre of pressure, with intervals.

    The intervals propagate the priors of the method `bayesian` for motors, encoders, legs and level through the statics.

    Raises:
        RecordingError: no recording of a standing robot, or no joint torques in it.
    """
    standing = [r for r in recordings if isinstance(r.trial, StandTrial) and r.complete]
    if not standing:
        raise RecordingError("the recordings contain no standing robot")
    rest = standing[-1].phase(Phase.REST)
    if rest.joints.torque is None:
        raise RecordingError("the recording has no joint torques; the method 'static' needs them")
    position, torque = rest.joints.position.mean(axis=0), rest.joints.torque.mean(axis=0)
    up = rest.imu.acceleration_in_imu.mean(axis=0) @ np.array(robot.imu_in_base.rotation).T
    priors, joints = Priors(), len(position)
    nominal = nominal_inertia(robot, stance.joint_position)
    at_stance = composite_parameters(robot, stance.joint_position).com
    stds = {
        "gain": [priors.torque_gain_common],
        "gains": [priors.torque_gain] * joints,
        "friction": joints
        * [priors.coulomb_friction * stance.scale.torque / np.sqrt(3)],  # anywhere between its limits
        "offsets": [priors.joint_offset] * joints,
        "legs": [priors.leg_mass_common],
        "tilt": [priors.imu_tilt, priors.imu_tilt],
    }

    def found(errors: FloatArray) -> FloatArray:
        gain, gains, friction, offsets, legs, tilt = np.split(
            errors, np.cumsum([len(part) for part in stds.values()])[:-1]
        )
        true, upward = torque * (1 + gain + gains) + friction, up / np.linalg.norm(up) + np.append(tilt, 0.0)
        upward /= np.linalg.norm(upward)
        return _mass_and_com(robot, at_stance, position - offsets, true, upward, 1 + float(legs[0]))

    sizes = np.concatenate([*stds.values()])
    values = found(np.zeros_like(sizes))
    effects = np.array([found(std * unit) - values for std, unit in zip(sizes, np.eye(len(sizes)), strict=True)])
    covariance = np.full((10, 10), np.nan)
    covariance[:3, :3] = effects.T @ effects
    hip, missing = priors.first_moment * stance.hip_height, 7 * [np.nan]
    return Calibration(
        **model_facts(robot, stance.joint_position),
        method=str(settings["method"]),
        composite=Body.of(
            [*values, *missing], covariance, [priors.mass * robot.mass, hip, hip, *missing], nominal.composite
        ),
        base=Body.partial(nominal.base),
        stance_effective=Body.partial(nominal.stance_effective),
        excitations={},
        support_lines={},
        trials=tuple(Trial(StandTrial.kind, "four feet", None, None, None, None, r.duration) for r in standing),
        settings=settings,
        assumptions=(
            f"standard deviations: torque gain {priors.torque_gain_common:.0%} in common and {priors.torque_gain:.0%} of each "
            f"joint, friction up to {priors.coulomb_friction * stance.scale.torque:.2g} Nm, joint offsets "
            f"{1e3 * priors.joint_offset:.0f} mrad, mass of the legs {priors.leg_mass_common:.0%}, level "
            f"{1e3 * priors.imu_tilt:.0f} mrad",
        ),
    )


def _mass_and_com(
    robot: RobotModel, at_stance: FloatArray, position: FloatArray, torque: FloatArray, up: FloatArray, leg_mass: float
) -> FloatArray:
    """Return the mass [kg], and x and y of the CoM at the nominal stance, at the height of the model's [m].

    Args:
        at_stance: (3,) CoM of the model at the nominal stance [m].
        position, torque: (nj,) joint positions [rad] and torques [Nm].
        up: (3,) unit vector against gravity, in base axes.
        leg_mass: factor on the masses of the leg links.
    """
    forces = foot_forces_from_torques(robot, position, torque - leg_mass * torques_of_legs(robot, position))
    carried = forces @ up
    centre = carried @ foot_positions(robot, position) / carried.sum()
    com = composite_parameters(robot, position).com
    centre = centre + (com - centre)[2] / up[2] * up  # the CoM is above the centre of pressure
    x, y, _ = centre + at_stance - com
    return np.array([carried.sum() / np.linalg.norm(robot.pinocchio.gravity.linear), x, y])
