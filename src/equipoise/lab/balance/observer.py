"""What a balancing robot feels: joint positions, which way is up, and how fast it turns, known sensor errors taken off."""

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

# [s] over which the accelerometer corrects the gyroscope: long against a fall, short against a gyroscope's drift.
_CORRECTION_TIME = 3.0
_UPRIGHT = float(np.cos(np.radians(25)))


@dataclass(frozen=True, eq=False)
class SensorKnowledge:
    """Sensor errors that are known and taken off.

    Attributes:
        joint_offset: (nj,) encoder reading less joint position [rad].
        imu_tilt: (3,) rotation vector of the IMU in the frame where it should be [rad].
        accelerometer_bias: (3,) bias of the accelerometer, in the IMU frame [m/s2].
    """

    joint_offset: FloatArray
    imu_tilt: FloatArray
    accelerometer_bias: FloatArray

    @classmethod
    def none(cls, robot: RobotModel) -> SensorKnowledge:
        """Sensors are taken at their word."""
        return cls(np.zeros(len(robot.joint_names)), np.zeros(3), np.zeros(3))

    @classmethod
    def of(cls, calibration: Calibration, robot: RobotModel) -> SensorKnowledge:
        """What a calibration found; methods other than `bayesian` find nothing."""
        found = {finding.name: finding.value for finding in calibration.sensors}

        def values(unknown: str) -> FloatArray:
            return np.array([found.get(name, 0.0) for name in finding_names(robot, unknown)])

        return cls(values("joint_offset"), values("imu_tilt"), values("accelerometer_bias"))

    @property
    def any(self) -> bool:
        """Whether anything is known."""
        return bool(self.joint_offset.any() or self.imu_tilt.any() or self.accelerometer_bias.any())


class Senses:
    """Turns sensor samples into joint positions, the direction of up and the angular velocity, in base axes.

    Args:
        robot: model of the robot, which says where the IMU is mounted.
        knowledge: sensor errors to take off.
        rest: samples of the robot at rest on four feet: they tell where up is and the gyroscope's bias.
        period: time between samples [s].

    Raises:
        FallError: the robot does not stand upright at rest.
    """

    def __init__(
        self, robot: RobotModel, knowledge: SensorKnowledge, rest: Sequence[RobotState], period: float
    ) -> None:
        self._zero, self._period = knowledge.joint_offset, period
        turned = Rotation.from_rotvec(knowledge.imu_tilt).as_matrix()
        self._to_base = np.array(robot.imu_in_base.rotation) @ turned
        self._accelerometer_bias = knowledge.accelerometer_bias
        self._gyro_bias = np.mean([state.angular_velocity_in_imu for state in rest], axis=0)
        up = np.mean([self._specific_force(state) for state in rest], axis=0)
        self.up: FloatArray = up / np.linalg.norm(up)
        self.joint_position: FloatArray = np.mean([state.joint_position for state in rest], axis=0) - self._zero
        self.angular_velocity_in_base: FloatArray = np.zeros(3)
        if self.up[2] < _UPRIGHT:
            raise FallError(
                f"the robot leans by {np.degrees(np.arccos(self.up[2])):.0f} deg when it should stand on four feet: it has "
                "fallen, or the IMU is mounted turned (give its pose under imu_rpy in a robot description)"
            )

    def feel(self, state: RobotState) -> None:
        """Take in the next sample: up turns against the base, and slowly goes to where the accelerometer points."""
        self.joint_position = state.joint_position - self._zero
        self.angular_velocity_in_base = self._to_base @ (state.angular_velocity_in_imu - self._gyro_bias)
        up = self.up - self._period * np.array(pin.skew(self.angular_velocity_in_base)) @ self.up
        force = self._specific_force(state)
        up += self._period / _CORRECTION_TIME * (force / np.linalg.norm(force) - up)
        self.up = up / np.linalg.norm(up)

    @property
    def lean(self) -> FloatArray:
        """(2,) small rotation of the base about its x and y axes from level [rad]."""
        return np.array([self.up[1], -self.up[0]])

    def command_for(self, joint_position: FloatArray) -> FloatArray:
        """What to send so that the joints go there: their loops close on the encoders."""
        return joint_position + self._zero

    def _specific_force(self, state: RobotState) -> FloatArray:
        return self._to_base @ (state.acceleration_in_imu - self._accelerometer_bias)


class Bearings:
    """Where the feet were planted, and from that where the body is over its support line.

    Attributes:
        footholds: (4, 3) centres of the planted feet, from the base frame's origin, the third axis vertical [m].

    Args:
        believed: model of the robot, whose centre of mass is over the line.
        diagonal: diagonal that it will stand on.
        senses: senses of the robot at rest on four feet.
    """

    def __init__(self, believed: RobotModel, diagonal: str, senses: Senses) -> None:
        self._kinematics = Kinematics(believed)
        self._right, self._left = (LEG_NAMES.index(leg) for leg in stance_legs(diagonal))
        self._lifted = [row for row in range(4) if row not in (self._right, self._left)]
        self.footholds = self._feet(senses)[0]

    def of(self, senses: Senses) -> tuple[float, float]:
        """How far the centre of mass is in front of the line, and the clearance of the lower lifted foot [m]."""
        feet, com = self._feet(senses)
        right, left = feet[self._right], feet[self._left]
        _, forward = line_through(right, left)
        rise = feet[:, 2] - self.footholds[:, 2]
        rise = rise - (rise[self._right] + rise[self._left]) / 2
        return float(forward @ (com - right)), float(rise[self._lifted].min())

    def _feet(self, senses: Senses) -> tuple[FloatArray, FloatArray]:
        """Feet and centre of mass from the base frame's origin, in axes of which the third is vertical."""
        upright = leveling(senses.up)
        feet = self._kinematics.foot_positions(senses.joint_position) @ upright.T
        return feet, upright @ self._kinematics.com(senses.joint_position)


def leveling(up: FloatArray) -> FloatArray:
    """(3, 3) the smallest rotation that turns a unit vector up."""
    x, y, z = up
    cross = np.array(pin.skew(np.array([y, -x, 0.0])))
    return np.eye(3) + cross + cross @ cross / (1 + z)
