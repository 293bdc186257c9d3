"""State estimation of a balancing robot from joint encoders and IMU, with corrected sensor errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from equipoise.conventions import FloatArray
from equipoise.errors import FallError
from equipoise.estimator.unknowns import finding_names
from equipoise.lab.balance.two_foot_posture import line_through, stance_legs
from equipoise.platform.platform import RobotState
from equipoise.result.calibration import Calibration
from equipoise.robot.description import LEG_NAMES
from equipoise.robot.kinematics import Kinematics
from equipoise.robot.model import RobotModel

# [s], time constant of the accelerometer's correction: longer than a fall, shorter than a gyroscope's drift.
_CORRECTION_TIME = 3.0
_UPRIGHT = float(np.cos(np.radians(25)))


@dataclass(frozen=True, eq=False)
class SensorCorrections:
    """Sensor errors that are subtracted from the measurements.

    Attributes:
        joint_offset: (nj,) encoder reading minus joint position [rad].
        imu_tilt: (3,) rotation vector of the IMU relative to its nominal frame [rad].
        accelerometer_bias: (3,) bias of the accelerometer, in the IMU frame [m/s2].
    """

    joint_offset: FloatArray
    imu_tilt: FloatArray
    accelerometer_bias: FloatArray

    @classmethod
    def none(cls, robot: RobotModel) -> SensorCorrections:
        """Return zero sensor errors."""
        return cls(np.zeros(len(robot.joint_names)), np.zeros(3), np.zeros(3))

    @classmethod
    def of(cls, calibration: Calibration, robot: RobotModel) -> SensorCorrections:
        """Return the sensor errors that a calibration estimated: zero for methods other than `bayesian`."""
        estimates = {finding.name: finding.value for finding in calibration.sensors}

        def values(parameter: str) -> FloatArray:
            return np.array([estimates.get(name, 0.0) for name in finding_names(robot, parameter)])

        return cls(values("joint_offset"), values("imu_tilt"), values("accelerometer_bias"))

    @property
    def any(self) -> bool:
        """True if a sensor error is not zero."""
        return bool(self.joint_offset.any() or self.imu_tilt.any() or self.accelerometer_bias.any())


class StateEstimator:
    """Estimator of joint positions, vertical direction and angular velocity in base axes.

    Args:
        robot: model of the robot, with the IMU's mounting.
        corrections: sensor errors to subtract.
        rest: samples of the robot at rest on four feet; they determine the vertical and the gyroscope's bias.
        period: time between samples [s].

    Raises:
        FallError: the robot does not stand upright at rest.
    """

    def __init__(
        self, robot: RobotModel, corrections: SensorCorrections, rest: Sequence[RobotState], period: float
    ) -> None:
        self._zero, self._period = corrections.joint_offset, period
        turned = Rotation.from_rotvec(corrections.imu_tilt).as_matrix()
        self._to_base = np.array(robot.imu_in_base.rotation) @ turned
        self._accelerometer_bias = corrections.accelerometer_bias
        self._gyro_bias = np.mean([state.angular_velocity_in_imu for state in rest], axis=0)
        up = np.mean([self._specific_force(state) for state in rest], axis=0)
        self.up: FloatArray = up / np.linalg.norm(up)
        self.joint_position: FloatArray = np.mean([state.joint_position for state in rest], axis=0) - self._zero
        self.angular_velocity_in_base: FloatArray = np.zeros(3)
        if self.up[2] < _UPRIGHT:
            raise FallError(
                f"the robot leans by {np.degrees(np.arccos(self.up[2])):.0f} deg when it should stand on four feet: it has "
                "fallen, or the orientation of the IMU is wrong (set imu_rpy in the robot configuration)"
            )

    def update(self, state: RobotState) -> None:
        """Integrate the gyroscope of the next sample, and correct the vertical slowly towards the accelerometer's."""
        self.joint_position = state.joint_position - self._zero
        self.angular_velocity_in_base = self._to_base @ (state.angular_velocity_in_imu - self._gyro_bias)
        up = self.up - self._period * np.array(pin.skew(self.angular_velocity_in_base)) @ self.up
        force = self._specific_force(state)
        up += self._period / _CORRECTION_TIME * (force / np.linalg.norm(force) - up)
        self.up = up / np.linalg.norm(up)

    @property
    def lean(self) -> FloatArray:
        """Rotation (2,) of the base from level about its x and y axes, small angles [rad]."""
        return np.array([self.up[1], -self.up[0]])

    def command_for(self, joint_position: FloatArray) -> FloatArray:
        """Return the encoder positions to command so that the joints reach these positions."""
        return joint_position + self._zero

    def _specific_force(self, state: RobotState) -> FloatArray:
        return self._to_base @ (state.acceleration_in_imu - self._accelerometer_bias)


def feet_and_com(robot: RobotModel, estimator: StateEstimator) -> tuple[FloatArray, FloatArray]:
    """Compute the (4, 3) feet and the (3,) CoM from the base frame's origin, the third axis vertical [m]."""
    kinematics, upright = Kinematics(robot), leveling(estimator.up)
    feet = kinematics.foot_positions(estimator.joint_position) @ upright.T
    return feet, upright @ kinematics.com(estimator.joint_position)


def com_and_clearance(
    robot: RobotModel, diagonal: str, footholds: FloatArray, estimator: StateEstimator
) -> tuple[float, float]:
    """Compute the distance of the CoM in front of a support line, and the clearance of the lower lifted foot [m].

    Args:
        robot: design model of the robot.
        footholds: (4, 3) centres of the feet when all stood on the floor, as in `feet_and_com` [m].
    """
    feet, com = feet_and_com(robot, estimator)
    right, left = (LEG_NAMES.index(leg) for leg in stance_legs(diagonal))
    _, forward = line_through(feet[right], feet[left])
    rise = feet[:, 2] - footholds[:, 2]
    rise = rise - (rise[right] + rise[left]) / 2
    return float(forward @ (com - feet[right])), float(np.delete(rise, [right, left]).min())


def leveling(up: FloatArray) -> FloatArray:
    """Return the (3, 3) smallest rotation that turns a unit vector to the vertical."""
    return np.array(pin.Quaternion.FromTwoVectors(up, np.array([0.0, 0.0, 1.0])).matrix())
