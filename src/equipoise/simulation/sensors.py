"""Sensor and actuator errors of a simulated robot, and the presets `ideal` and `realistic`.

Errors that are constant over a run (joint zeros, IMU tilt, gains) are drawn once from the seed. Noise is keyed by the
seed and the sample's index, so that it does not depend on the pieces in which a motion is simulated.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import SettingsError
from equipoise.robot.scale import Scale

Noise = Literal["ideal", "realistic"]

_NOISE_BLOCK = 1024


@dataclass(frozen=True)
class SensorErrors:
    """Sizes of the errors of a simulated robot: rms values, unless they say otherwise. All zero: a perfect one.

    Attributes:
        encoder_noise: noise of the encoders [rad].
        joint_zero: constant offset of each encoder [rad].
        joint_velocity_noise: noise of the joint velocities [rad/s].
        gyro_noise: noise of the gyroscope, per axis [rad/s].
        gyro_bias: constant bias of the gyroscope, per axis [rad/s].
        accelerometer_noise: noise of the accelerometer, per axis [m/s2].
        accelerometer_bias: constant bias of the accelerometer, per axis [m/s2].
        imu_tilt: constant mounting error of the IMU, per axis [rad].
        torque_noise: noise of the joint torques [Nm].
        coulomb_friction: Coulomb friction of each joint, exact [Nm].
        viscous_friction: viscous friction of each joint, exact [Nm s/rad].
        armature: rotor inertia seen at each joint, exact [kg m2].
        torque_gain: true torque over reported torque, less one, constant per joint.
        leg_mass: relative error of each leg link's mass, first moment and inertia.
        command_delay: delay from sending a command until it acts, exact [s].
        sensor_delay: delay from sensing until the time stamp, exact [s].
        imu_clock_offset: time by which IMU samples are younger than joint samples of the same stamp, exact [s].
        floor_friction: friction coefficient of the floor, exact.
        floor_slope: angle between gravity and the floor's normal, exact; its direction is drawn [rad].
    """

    encoder_noise: float = 0.0
    joint_zero: float = 0.0
    joint_velocity_noise: float = 0.0
    gyro_noise: float = 0.0
    gyro_bias: float = 0.0
    accelerometer_noise: float = 0.0
    accelerometer_bias: float = 0.0
    imu_tilt: float = 0.0
    torque_noise: float = 0.0
    coulomb_friction: float = 0.0
    viscous_friction: float = 0.0
    armature: float = 0.0
    torque_gain: float = 0.0
    leg_mass: float = 0.0
    command_delay: float = 0.0
    sensor_delay: float = 0.0
    imu_clock_offset: float = 0.0
    floor_friction: float = 1.0
    floor_slope: float = 0.0

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not (np.isfinite(value) and (value >= 0 or field.name == "imu_clock_offset")):
                raise SettingsError(f"{field.name} is {value}; it must be a finite number, zero or more")
        if self.imu_clock_offset > self.sensor_delay:
            raise SettingsError(
                f"imu_clock_offset is {self.imu_clock_offset} s and sensor_delay {self.sensor_delay} s: IMU samples would be "
                "younger than the moment at which they are read"
            )

    def scaled_to(self, scale: Scale) -> SensorErrors:
        """An A1's errors on a robot of another size: torques, friction and armature grow with it, all else stays."""
        scaled = ("torque_noise", "coulomb_friction", "viscous_friction", "armature")
        return dataclasses.replace(self, **{name: getattr(self, name) * scale.torque for name in scaled})


IDEAL = SensorErrors()
"""No noise, no bias, no friction, exact leg model; soft position control and contact as simulated."""

REALISTIC = SensorErrors(
    encoder_noise=0.3e-3,
    joint_zero=5e-3,
    joint_velocity_noise=0.03,
    gyro_noise=3e-3,
    gyro_bias=2e-3,
    accelerometer_noise=0.05,
    accelerometer_bias=0.03,
    imu_tilt=5e-3,
    torque_noise=0.2,
    coulomb_friction=0.3,
    viscous_friction=0.05,
    armature=0.01,
    torque_gain=0.03,
    leg_mass=0.03,
    command_delay=2e-3,
    sensor_delay=2e-3,
    imu_clock_offset=0.5e-3,
    floor_friction=0.8,
    floor_slope=5e-3,
)
"""An A1's values, for a robot with the A1's m g h."""

PRESETS: dict[Noise, SensorErrors] = {"ideal": IDEAL, "realistic": REALISTIC}


@dataclass(frozen=True, eq=False)
class DrawnErrors:
    """The constant errors of one simulated robot, drawn from a seed.

    Attributes:
        sizes: sizes that they were drawn from.
        noise_seed: seed of the noise.
        joint_zero: (nj,) encoder reading minus joint position [rad].
        torque_gain: (nj,) true torque over reported torque.
        gyro_bias: (3,) bias of the gyroscope, in the IMU frame [rad/s].
        accelerometer_bias: (3,) bias of the accelerometer, in the IMU frame [m/s2].
        imu_tilt: (3,) rotation vector of the IMU in the frame where it should be [rad].
        leg_mass_scale: (nj,) true over modelled mass of the link that each joint moves.
        gravity_direction: (3,) unit vector in the floor's frame, downward.
    """

    sizes: SensorErrors
    noise_seed: int
    joint_zero: FloatArray
    torque_gain: FloatArray
    gyro_bias: FloatArray
    accelerometer_bias: FloatArray
    imu_tilt: FloatArray
    leg_mass_scale: FloatArray
    gravity_direction: FloatArray

    @classmethod
    def draw(cls, sizes: SensorErrors, joints: int, seed: int, noise_seed: int | None = None) -> DrawnErrors:
        """Draw the constant errors of a robot with that many joints; its noise is the seed's, or that of a seed of its own."""
        noise_seed = seed if noise_seed is None else noise_seed
        if min(seed, noise_seed) < 0:
            raise SettingsError(f"the seed is {min(seed, noise_seed)}; it must be zero or more")
        generator = np.random.default_rng([seed, 0])

        def normal(size: float, count: int) -> FloatArray:
            return size * generator.standard_normal(count)

        azimuth = generator.uniform(0, 2 * np.pi)
        sine = np.sin(sizes.floor_slope)
        down = np.array([sine * np.cos(azimuth), sine * np.sin(azimuth), -np.cos(sizes.floor_slope)])
        return cls(
            sizes,
            noise_seed,
            joint_zero=normal(sizes.joint_zero, joints),
            torque_gain=1 + normal(sizes.torque_gain, joints),
            gyro_bias=normal(sizes.gyro_bias, 3),
            accelerometer_bias=normal(sizes.accelerometer_bias, 3),
            imu_tilt=normal(sizes.imu_tilt, 3),
            leg_mass_scale=1 + normal(sizes.leg_mass, joints),
            gravity_direction=down,
        )

    def noise(self, first_sample: int, count: int) -> FloatArray:
        """(count, 3 nj + 6) noise of consecutive samples.

        Columns: positions, velocities, torques, gyroscope, accelerometer. The same sample has the same noise however the
        samples are asked for.
        """
        scale = self._noise_scale
        noise = np.zeros((count, scale.size))
        if scale.any():
            done = 0
            while done < count:
                block, start = divmod(first_sample + done, _NOISE_BLOCK)
                part = _standard_noise(self.noise_seed, block, scale.size)[start : start + count - done]
                np.multiply(part, scale, out=noise[done : done + len(part)])
                done += len(part)
        return noise

    @cached_property
    def _noise_scale(self) -> FloatArray:
        """Standard deviation of each column of the noise."""
        sizes, joints = self.sizes, self.joint_zero.size
        columns = [sizes.encoder_noise, sizes.joint_velocity_noise, sizes.torque_noise, sizes.gyro_noise]
        return np.repeat([*columns, sizes.accelerometer_noise], [joints, joints, joints, 3, 3])


@lru_cache(maxsize=4)  # a robot that is stepped asks for the same block a thousand times
def _standard_noise(seed: int, block: int, columns: int) -> FloatArray:
    noise = np.random.default_rng([seed, 1, block]).standard_normal((_NOISE_BLOCK, columns))
    noise.setflags(write=False)
    return noise
