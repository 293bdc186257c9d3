"""What the precise method takes to be unknown, what it believes of it beforehand, and in which order it is kept."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import pinocchio as pin

from equipoise.conventions import FloatArray
from equipoise.errors import SettingsError
from equipoise.precise.measurements.tilt_equation import SensorBiases
from equipoise.robot.inertial import InertialParameters, base_parameters
from equipoise.robot.model import A1_TORQUE_SCALE, RobotModel
from equipoise.robot.stance import Stance


@dataclass(frozen=True)
class Priors:
    """Standard deviations of what is believed before anything is measured; all of mean zero (or of the model's value).

    Attributes:
        mass: of the whole robot, as a fraction of the model's. A payload of half the robot's mass is two of these.
        first_moment: of the base's CoM, times the model's base mass, over the hip height.
        inertia: of the base's tensor about its origin, over the model's largest moment.
        leg_mass: of each leg link's mass, first moment and inertia, as a fraction.
        joint_zero: [rad].
        imu_tilt: per axis [rad].
        accelerometer_bias: [m/s2].
        clock_offset: of IMU against joint samples [s].
        foot_radius: as a fraction, common to all feet.
        floor_slope: per axis [rad].
        floor_warp: height of two diagonal footholds against the other two, over the hip height.
        torque_gain: true over reported torque, less one.
        coulomb, viscous, armature: of an A1's joints; others' scale with m g h [Nm], [Nm s/rad], [kg m2].
    """

    mass: float = 0.3
    first_moment: float = 0.3
    inertia: float = 2.0
    leg_mass: float = 0.03
    joint_zero: float = 5e-3
    imu_tilt: float = 6e-3
    accelerometer_bias: float = 0.03
    clock_offset: float = 1e-3
    foot_radius: float = 0.02
    floor_slope: float = 5e-3
    floor_warp: float = 1e-3
    torque_gain: float = 0.03
    coulomb: float = 0.5
    viscous: float = 0.1
    armature: float = 0.02

    def __post_init__(self) -> None:
        for field in fields(self):
            if not getattr(self, field.name) > 0:
                raise SettingsError(f"the prior of {field.name} is {getattr(self, field.name)}; it must be above zero")


class Unknowns:
    """The vector of unknowns: ten log-Cholesky parameters of the base, then everything else in units of its prior.

    Attributes:
        size: of the vector.
        base, links, joint_zero, imu_tilt, accelerometer_bias, clock_offset, foot_radius: slices.
        floor_slope, floor_warp, torque_gain, coulomb, viscous, armature: slices.
        biases: slice of all that the kinematics depend on.
        scale: (size,) what one unit is; one for the base.
        torque_scale: the robot's m g h over an A1's.
    """

    def __init__(self, robot: RobotModel, stance: Stance, priors: Priors) -> None:
        self.robot, self.stance, self.priors = robot, stance, priors
        joints = len(robot.joint_names)
        self.torque_scale = robot.torque_scale(stance.hip_height) / A1_TORQUE_SCALE
        blocks = [
            ("base", 10, 1.0),
            ("links", joints, priors.leg_mass),
            ("joint_zero", joints, priors.joint_zero),
            ("imu_tilt", 3, priors.imu_tilt),
            ("accelerometer_bias", 3, priors.accelerometer_bias),
            ("clock_offset", 1, priors.clock_offset),
            ("foot_radius", 1, priors.foot_radius),
            ("floor_slope", 2, priors.floor_slope),
            ("floor_warp", 1, priors.floor_warp * stance.hip_height),
            ("torque_gain", joints, priors.torque_gain),
            ("coulomb", 1, priors.coulomb * self.torque_scale),
            ("viscous", 1, priors.viscous * self.torque_scale),
            ("armature", 1, priors.armature * self.torque_scale),
        ]
        self._slices: dict[str, slice] = {}
        position = 0
        for name, count, _ in blocks:
            self._slices[name] = slice(position, position + count)
            position += count
        self.size = position
        self.scale = np.concatenate([np.full(count, size) for _, count, size in blocks])
        self.biases = slice(self._slices["joint_zero"].start, self._slices["floor_warp"].stop)
        self.model_base = base_parameters(robot)
        self.model_base_vector = self.model_base.vector

    def __getitem__(self, name: str) -> slice:
        return self._slices[name]

    def start(self) -> FloatArray:
        """(size,) the model's own values."""
        x = np.zeros(self.size)
        x[self["base"]] = log_cholesky(self.model_base)
        return x

    def value(self, x: FloatArray, name: str) -> FloatArray:
        """A block in its own units."""
        return np.asarray(x[self[name]] * self.scale[self[name]])

    def sensor_biases(self, x: FloatArray) -> SensorBiases:
        """The blocks that the kinematics depend on."""
        return SensorBiases(
            self.value(x, "joint_zero"),
            self.value(x, "imu_tilt"),
            self.value(x, "accelerometer_bias"),
            float(self.value(x, "clock_offset")[0]),
            1 + float(self.value(x, "foot_radius")[0]),
            self.value(x, "floor_slope"),
        )

    def inertial(self, x: FloatArray) -> FloatArray:
        """(10 + links,) the base's parameters (Pinocchio's order, about its origin) and factors on the leg links."""
        return np.concatenate([base_vector(x[self["base"]]), 1 + self.value(x, "links")])

    def inertial_jacobian(self, x: FloatArray) -> FloatArray:
        """(10 + links, size) derivative of `inertial`."""
        links = self["links"].stop - self["links"].start
        jacobian = np.zeros((10 + links, self.size))
        jacobian[:10, self["base"]] = pin.LogCholeskyParameters(x[self["base"]]).calculateJacobian()
        jacobian[10:, self["links"]] = self.priors.leg_mass * np.eye(links)
        return jacobian

    def base_body(self, x: FloatArray) -> InertialParameters:
        """The base."""
        return InertialParameters.from_pinocchio(pin.Inertia.FromDynamicParameters(base_vector(x[self["base"]])))

    def robot_body(self, x: FloatArray) -> InertialParameters:
        """The whole robot frozen at the nominal stance, in the base frame."""
        return self._frozen(x, below_knees=True)

    def stance_effective_body(self, x: FloatArray) -> InertialParameters:
        """The paper's body: base, hips and thighs, about its own CoM."""
        return self._frozen(x, below_knees=False)

    def _frozen(self, x: FloatArray, below_knees: bool) -> InertialParameters:
        model, data = self.robot.pinocchio, self.robot.pinocchio_data
        total = pin.Inertia.FromDynamicParameters(base_vector(x[self["base"]]))
        pin.forwardKinematics(model, data, self.robot.configuration(self.stance.joint_position))
        joints = [(joint, leg.joint_ids[-1]) for leg in self.robot.legs.values() for joint in leg.joint_ids]
        for factor, (joint, knee) in zip(1 + self.value(x, "links"), joints, strict=True):
            if below_knees or joint != knee:
                link = model.inertias[joint]
                scaled = pin.Inertia(link.mass * factor, link.lever, link.inertia * factor)
                total = total + data.oMi[joint].act(scaled)
        return InertialParameters.from_pinocchio(total)


def log_cholesky(body: InertialParameters) -> FloatArray:
    """(10,) log-Cholesky parameters of a body (Rucker and Wensing 2022), in Pinocchio's order.

    Every vector is a body that can exist: its pseudo-inertia is U U^T with an upper triangular U.
    """
    about_origin = body.vector
    xx, xy, yy, xz, yz, zz = about_origin[4:]
    rotational = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    pseudo = np.empty((4, 4))
    pseudo[:3, :3] = np.trace(rotational) / 2 * np.eye(3) - rotational
    pseudo[:3, 3] = pseudo[3, :3] = about_origin[1:4]
    pseudo[3, 3] = body.mass
    upper = np.linalg.cholesky(pseudo[::-1, ::-1])[::-1, ::-1] / np.sqrt(body.mass)
    d1, d2, d3 = np.log(np.diag(upper)[:3])
    return np.array(
        [
            np.log(body.mass) / 2,
            d1,
            d2,
            d3,
            upper[0, 1],
            upper[1, 2],
            upper[0, 2],
            upper[0, 3],
            upper[1, 3],
            upper[2, 3],
        ]
    )


def base_vector(parameters: FloatArray) -> FloatArray:
    """(10,) inertial parameters about the origin, in Pinocchio's order, from log-Cholesky parameters."""
    return np.array(pin.LogCholeskyParameters(parameters).toDynamicParameters())
