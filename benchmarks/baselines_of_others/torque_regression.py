"""Motors from reported torques by ordinary least squares, one joint after the other: what a text book does.

    tau - Y(q, v, a) pi = F_c sgn(v) + F_v v + A a + o

Y pi is the inverse dynamics of the model file's legs, which are trusted, o an offset. Torques are taken as they were sampled,
gains as one. All signals go through the same low-pass filter without delay, the sign of the velocity too; samples about which
a joint turned back are left out.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from baselines_of_others.held_base import JointParameters, Swing
from equipoise.robot.model import RobotModel
from equipoise.robot.scale import Scale

FloatArray = NDArray[np.float64]

# Of 8, 12, 20 and 30 Hz (on an A1, whose swings end at 6 Hz) and of 0, 0.5, 0.8 and 0.95 these suited an A1 and a Go2 of a
# tuning seed best; at 45 Hz viscous friction was off by half on the Go2.
CUTOFF, SLIDES = 30.0, 0.5
_STICTION_SPEED = 0.03  # [rad/s], below which Coulomb friction is not yet its full size
_MARGIN = 0.3  # [s] cut off both ends, where the filter has not all it needs
_STRIDE = 2  # one sample in so many is used


def fit(
    robot: RobotModel, swing: Swing, scale: Scale, cutoff: float = CUTOFF, slides: float = SLIDES
) -> JointParameters:
    """Friction and armature of each joint; no delay, no bias.

    Args:
        scale: of the robot; the filter is slower on a larger one.
        cutoff: of the filter, on an A1 [Hz].
        slides: smoothed |sgn(v)| from which on samples are used.
    """
    assert swing.torque is not None
    period = float(np.median(np.diff(swing.time)))
    sos = butter(4, cutoff / scale.time, fs=1 / period, output="sos")

    def smooth(values: FloatArray) -> FloatArray:
        return np.asarray(sosfiltfilt(sos, values, axis=0))

    position = smooth(swing.position)
    velocity = np.gradient(position, period, axis=0)
    acceleration = np.gradient(velocity, period, axis=0)
    sign, torque = smooth(np.tanh(velocity / _STICTION_SPEED)), smooth(swing.torque)
    margin = round(_MARGIN / period)
    kept = slice(margin, -margin, _STRIDE)
    model = leg_torques(robot, swing.gravity_in_base, position[kept], velocity[kept], acceleration[kept])
    columns = np.stack([sign, velocity, acceleration, np.ones_like(sign)], axis=-1)[kept]
    left, used = torque[kept] - model, np.abs(sign[kept]) > slides
    coulomb_friction, viscous_friction, armature, _ = np.array(
        [np.linalg.lstsq(columns[u, j], left[u, j], rcond=None)[0] for j, u in enumerate(used.T)]
    ).T
    return JointParameters(
        armature, viscous_friction, coulomb_friction, 0 * coulomb_friction, np.ones_like(coulomb_friction), np.nan
    )


def leg_torques(
    robot: RobotModel, gravity_in_base: FloatArray, position: FloatArray, velocity: FloatArray, acceleration: FloatArray
) -> FloatArray:
    """(n, nj) inverse dynamics of the model file's legs on a base at rest [Nm].

    Args:
        gravity_in_base: (3,) [m/s2].
        position, velocity, acceleration: (n, nj) of the joints [rad], [rad/s], [rad/s2].
    """
    model, rest = robot.pinocchio.copy(), np.zeros(6)
    model.gravity.linear = gravity_in_base
    data = model.createData()
    torques = [
        pin.rnea(model, data, robot.configuration(q), np.concatenate([rest, v]), np.concatenate([rest, a]))[6:]
        for q, v, a in zip(position, velocity, acceleration, strict=True)
    ]
    return np.array(torques)
