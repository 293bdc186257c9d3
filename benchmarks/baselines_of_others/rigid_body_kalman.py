"""A Kalman filter on the single-rigid-body model, whose state is the body's inertial parameters.

Newton's and Euler's equations of one body are linear in its ten parameters pi (C. Atkeson, C. An and J. Hollerbach,
"Estimation of Inertial Parameters of Manipulator Loads and Links", IJRR 1986): with the body's acceleration less gravity a,
angular velocity w and angular acceleration dw, the feet's forces f_i at r_i make

    H(a, w, dw) pi = [ sum f_i ; sum r_i x f_i ],        f = J_j^-T (t_legs - tau + c tanh(v / v_0) + d v + e dv),

by the joint torques tau, friction c and d and armature e of all joints, and the torques t_legs that the legs' own motion
takes. The state x = (pi, c, d, e) does not change but for a slow random walk; each sample is a measurement of six numbers
(R. Kalman, "A New Approach to Linear Filtering and Prediction Problems", 1960):

    P <- P + Q dt,   K = P H^T (H P H^T + R)^-1,   x <- x + K (z - H x),   P <- (1 - K H) P (1 - K H)^T + K R K^T.

R is what torques of a given uncertainty do to the six numbers. Two bodies are offered: the whole robot as one, whose legs
are taken to have no motion of their own (what controllers on the single-rigid-body model assume), or the base alone with
the legs' forces from the model file. No robot with legs of two joints: their forces do not follow from torques.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baselines_of_others.filtered import Acceleration, Filtered, Motions, contact_jacobians
from equipoise.robot.inertial import InertialParameters, composite_parameters
from equipoise.robot.model import RobotModel

FloatArray = NDArray[np.float64]

_RATE = 125.0  # [Hz] of the samples
_MASS_PRIOR, _MOMENT_PRIOR, _INERTIA_PRIOR = 0.5, 0.5, 3.0  # wide: in parts of the model's own sizes
_LOSS_PRIORS = np.array([2.0, 0.5, 0.1])  # friction [Nm], [Nm s/rad] and armature [kg m2] on an A1; wide
_A1_MASS = 12.5  # [kg]


@dataclass(frozen=True)
class KalmanSettings:
    """How it is used; the defaults are the best of those that were tried.

    Attributes:
        cutoff: of the low-pass filter on an A1 [Hz].
        acceleration: where the body's acceleration comes from.
        motions: which recordings.
        body: "whole": all of the robot as one rigid body; "base": the legs' dynamics are the model's.
        losses: whether friction and armature are in the state.
        torque_sd: uncertainty of a joint's torque in one sample, on an A1 [Nm].
        acceleration_sd: uncertainty of the body's acceleration in one sample [m/s2]; on two feet, whose forces have no moment
            about the line between them, it alone stands against the model's errors.
        drift: of each parameter, in parts of its prior per square root of a second.
    """

    cutoff: float = 9.0
    acceleration: Acceleration = "accelerometer"
    motions: Motions = "all"
    body: Literal["whole", "base"] = "base"
    losses: bool = True
    torque_sd: float = 10.0
    acceleration_sd: float = 0.7
    drift: float = 0.0


@dataclass(eq=False)
class Filter:
    """A Kalman filter of a constant state.

    Attributes:
        state, covariance: estimate so far and its covariance.
        drift: (n,) variance per second.
    """

    state: FloatArray
    covariance: FloatArray
    drift: FloatArray

    def predict(self, duration: float) -> None:
        self.covariance = self.covariance + duration * np.diag(self.drift)

    def correct(self, measured: FloatArray, matrix: FloatArray, noise: FloatArray) -> None:
        gain = np.linalg.solve(matrix @ self.covariance @ matrix.T + noise, matrix @ self.covariance).T
        self.state = self.state + gain @ (measured - matrix @ self.state)
        kept = np.eye(len(self.state)) - gain @ matrix
        self.covariance = kept @ self.covariance @ kept.T + gain @ noise @ gain.T


def estimate(
    robot: RobotModel,
    samples: Filtered,
    joint_position: FloatArray,
    settings: KalmanSettings,
    mass: tuple[float, float] | None = None,
) -> InertialParameters:
    """The whole robot at a stance.

    Args:
        joint_position: (nj,) of the stance [rad].
        mass: of the whole robot from a scale and its standard deviation [kg], or None.
    """
    filtered = run(robot, samples, joint_position, settings, mass)
    body = pin.Inertia.FromDynamicParameters(filtered.state[:10])
    if settings.body == "whole":
        return InertialParameters.from_pinocchio(body)
    return composite_parameters(robot.with_base(body), joint_position)


def run(
    robot: RobotModel,
    samples: Filtered,
    joint_position: FloatArray,
    settings: KalmanSettings,
    mass: tuple[float, float] | None = None,
) -> Filter:
    """All samples through the filter, in order."""
    model = robot.pinocchio.copy()
    model.gravity.linear = np.zeros(3)  # it is in the acceleration that the body feels
    data = model.createData()
    whole = settings.body == "whole"
    legs = np.concatenate([inertia.toDynamicParameters() for inertia in list(model.inertias)[2:]])
    body = composite_parameters(robot, joint_position).to_pinocchio() if whole else model.inertias[1]
    filtered = _start(body, robot.mass / _A1_MASS, settings)
    if mass is not None:
        weight = np.eye(1, len(filtered.state))
        of_legs = 0.0 if whole else float(legs[::10].sum())
        filtered.correct(np.array([mass[0] - of_legs]), weight, np.array([[mass[1] ** 2]]))
    variance = (settings.torque_sd * robot.mass / _A1_MASS) ** 2
    height = float(np.linalg.norm(contact_jacobians(robot, joint_position, np.array([0.0, 0, 1]))[0, 3:6]))
    unsure = np.diag(np.repeat(robot.mass * settings.acceleration_sd * np.array([1.0, height]), 3) ** 2)
    joints_of = [list(leg.joints) for leg in robot.legs.values()]
    for index in range(samples.count):
        position = samples.position[index]
        feet = np.flatnonzero(samples.standing[index])
        used = np.concatenate(
            [joints_of[foot] for foot in feet]
        )  # a lifted leg's torques say nothing of the feet's forces
        jacobian = contact_jacobians(robot, position, samples.up[index])[np.repeat(samples.standing[index], 3)]
        to_body = np.linalg.solve(jacobian[:, 6 + used], jacobian[:, :6]).T  # J_b^T J_j^-T
        velocity = np.concatenate([np.zeros(3), samples.turning[index], samples.velocity[index]])
        acceleration = np.concatenate([samples.felt[index], samples.turning_rate[index], samples.acceleration[index]])
        regressor = pin.computeJointTorqueRegressor(model, data, robot.configuration(position), velocity, acceleration)
        measured = -to_body @ samples.torque[index, used]
        if not whole:
            measured += to_body @ (regressor[6 + used, 10:] @ legs) - regressor[:6, 10:] @ legs
        matrix = regressor[:6, :10]
        if settings.losses:
            parts = (samples.friction[index], samples.velocity[index], samples.acceleration[index])
            matrix = np.column_stack([matrix, *(-to_body @ part[used] for part in parts)])
        filtered.predict(1 / _RATE)
        filtered.correct(measured, matrix, variance * to_body @ to_body.T + unsure)
    return filtered


def _start(body: pin.Inertia, scale: float, settings: KalmanSettings) -> Filter:
    length = float(np.sqrt(np.trace(body.inertia) / body.mass))
    std = body.mass * np.repeat([_MASS_PRIOR, _MOMENT_PRIOR * length, _INERTIA_PRIOR * length**2], [1, 3, 6])
    state = np.array(body.toDynamicParameters())
    if settings.losses:
        state, std = np.append(state, np.zeros(3)), np.append(std, _LOSS_PRIORS * scale)
    return Filter(state, np.diag(std**2), (settings.drift * std) ** 2)
