"""Effects of one simulated robot, drawn from a seed, and the noise of its sensors.

What is constant over a run (joint offsets, IMU tilt, gains) is drawn once from the seed. Noise is keyed by the seed and the
sample's index, so that it does not depend on the pieces in which a motion is simulated.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from equipoise.conventions import FloatArray
from equipoise.errors import SettingsError
from equipoise.simulation.effects import EffectSizes
from equipoise.small_arrays import any_of

_NOISE_BLOCK = 1024
# [rad/s]: speed at which a joint's friction has lost two thirds of what it has more at rest.
_STRIBECK_SPEED = 0.1
# These share one stream, in this order. All others have one each, so that none changes what another draws.
_ONE_STREAM = (
    "floor_slope", "joint_offset", "torque_gain", "gyro_bias", "accelerometer_bias", "imu_tilt", "leg_mass",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class DrawnErrors:
    """Effects of one simulated robot.

    Attributes:
        sizes: sizes that they were drawn from.
        noise_seed: seed of the noise.
        drawn: values of each effect by the name of its row, one per part, in its unit (of a direction: its angle).
    """

    sizes: EffectSizes
    noise_seed: int
    drawn: Mapping[str, FloatArray]

    @classmethod
    def draw(cls, sizes: EffectSizes, joints: int, seed: int, noise_seed: int | None = None) -> DrawnErrors:
        """Draw the constant errors of a robot with that many joints; its noise is the seed's, or that of a seed of its own."""
        noise_seed = seed if noise_seed is None else noise_seed
        for name, value in (("seed", seed), ("seed of the noise", noise_seed)):
            if value < 0:
                raise SettingsError(f"the {name} is {value}; it must be zero or more")
        shared = np.random.default_rng([seed, 0])
        drawn: dict[str, FloatArray] = {}
        for row in (*map(sizes.row, _ONE_STREAM), *(row for row in sizes.rows() if row.name not in _ONE_STREAM)):
            generator = shared if row.name in _ONE_STREAM else named_generator(seed, row.name)
            drawn[row.name] = row.drawn(generator, getattr(sizes, row.name), joints)
        return cls(sizes, noise_seed, drawn)

    @cached_property
    def torque_gain(self) -> FloatArray:
        """(nj,) true torque over reported torque."""
        return (1 + self.drawn["torque_gain"]) * (1 + self.drawn["torque_gain_common"])

    @cached_property
    def leg_mass_scale(self) -> FloatArray:
        """(nj,) true over modelled mass of the link that each joint moves."""
        return (1 + self.drawn["leg_mass"]) * (1 + self.drawn["leg_mass_common"])

    @cached_property
    def leg_inertia_scale(self) -> FloatArray:
        """(nj,) inertia of the link that each joint moves, about its CoM, over that which follows from its mass."""
        return 1 + self.drawn["leg_inertia"]

    @cached_property
    def hip_position(self) -> FloatArray:
        """(4, 3) first joints of the legs FL FR RL RR less the model's, in the base link's axes [m]."""
        return self.drawn["hip_position"].reshape(4, 3)

    @cached_property
    def gyro_matrix(self) -> FloatArray:
        """(3, 3) reading of the gyroscope, less its bias, over the angular velocity in the IMU frame."""
        x, y, z = self.drawn["gyro_turn"]
        gains = np.diag(1 + self.drawn["gyro_gain"])
        gains[~np.eye(3, dtype=bool)] = self.drawn["gyro_misalignment"]
        # The transposed rotation to first order, made orthogonal.
        u, _, v = np.linalg.svd(np.array([[1, z, -y], [-z, 1, x], [y, -x, 1]]))
        return gains @ u @ v

    @cached_property
    def gravity_direction(self) -> FloatArray:
        """(3,) unit vector in the floor's frame, downward."""
        azimuth, sine = self.drawn["floor_slope"][0], np.sin(self.sizes.floor_slope)
        return np.array([sine * np.cos(azimuth), sine * np.sin(azimuth), -np.cos(self.sizes.floor_slope)])

    @cached_property
    def floor_friction(self) -> float:
        """Friction coefficient of the floor."""
        return max(float(self.sizes.floor_friction + self.drawn["floor_friction_spread"][0]), 0.0)

    @cached_property
    def cable_in_world(self) -> FloatArray:
        """(3,) constant force on the base, across gravity [N]."""
        azimuth, down = self.drawn["cable"][0], self.gravity_direction
        towards = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        towards -= (towards @ down) * down
        return self.sizes.cable * towards / np.linalg.norm(towards)

    @cached_property
    def coulomb_friction(self) -> FloatArray:
        """(nj,) Coulomb friction [Nm]."""
        return self.sizes.coulomb_friction * self.drawn["friction_spread"]

    @cached_property
    def viscous_friction(self) -> FloatArray:
        """(nj,) viscous friction [Nm s/rad]."""
        return self.sizes.viscous_friction * self.drawn["friction_spread"]

    def sliding_friction(self, speed: FloatArray, torque: FloatArray) -> FloatArray:
        """Return (nj,) largest non-viscous friction of the joints at speeds [rad/s] and true motor torques [Nm]."""
        sizes, friction = self.sizes, self.coulomb_friction
        if sizes.stribeck:
            ratio = speed / _STRIBECK_SPEED
            friction = friction * (1 + sizes.stribeck * np.exp(-ratio * ratio))
        if sizes.load_friction:
            friction = friction + sizes.load_friction * abs(torque)
        return friction

    @cached_property
    def spring_stiffness(self) -> FloatArray:
        """(nj,) stiffness of the springs behind the motors [Nm/rad]; zero: there are none."""
        return self.sizes.springs * self.drawn["spring_spread"]

    def encoder_error(self, position: FloatArray) -> FloatArray:
        """Return (..., nj) error of the encoders at joint positions [rad], without the joint offsets."""
        return self.sizes.encoder_eccentricity * np.sin(position - self.drawn["encoder_eccentricity"])

    def encoder_error_slope(self, position: FloatArray) -> FloatArray:
        """Return (..., nj) derivative of `encoder_error` by the position."""
        return self.sizes.encoder_eccentricity * np.cos(position - self.drawn["encoder_eccentricity"])

    def noise(self, first_sample: int, count: int) -> FloatArray:
        """Return (count, 3 nj + 6) noise of consecutive samples.

        Columns: positions, velocities, torques, gyroscope, accelerometer. The same sample has the same noise however the
        samples are asked for.
        """
        return _keyed(self.noise_seed, 1, first_sample, count, self._noise_scale)

    def jitter(self, first_sample: int, count: int) -> FloatArray:
        """Return (count,) time stamps of consecutive samples minus their read times [s]; keyed as the noise."""
        return _keyed(self.noise_seed, 3, first_sample, count, np.array([self.sizes.jitter]))[:, 0]

    def lost(self, first_sample: int, count: int) -> NDArray[np.bool_]:
        """Return (count,) whether consecutive samples are lost; keyed as the noise."""
        drawn = _keyed(self.noise_seed, 4, first_sample, count, np.ones(1))[:, 0]
        share = self.sizes.lost_samples
        return drawn < (NormalDist().inv_cdf(share) if share else -np.inf)

    @cached_property
    def _noise_scale(self) -> FloatArray:
        """Standard deviation of each column of the noise."""
        sizes, joints = self.sizes, self.drawn["joint_offset"].size
        columns = [sizes.encoder_noise, sizes.joint_velocity_noise, sizes.torque_noise, sizes.gyro_noise]
        return np.repeat([*columns, sizes.accelerometer_noise], [joints, joints, joints, 3, 3])


def named_generator(seed: int, name: str) -> np.random.Generator:
    """Return the random stream of a name, independent of the draws of other names."""
    return np.random.default_rng([seed, 2, *name.encode()])


def _keyed(seed: int, stream: int, first: int, count: int, scale: FloatArray) -> FloatArray:
    """Return (count, n) normal numbers of consecutive samples, one column for each of the (n,) standard deviations."""
    noise = np.zeros((count, scale.size))
    if any_of(scale > 0):
        done = 0
        while done < count:
            block, start = divmod(first + done, _NOISE_BLOCK)
            part = _standard_noise(seed, stream, block, scale.size)[start : start + count - done]
            np.multiply(part, scale, out=noise[done : done + len(part)])
            done += len(part)
    return noise


@lru_cache(maxsize=12)  # a robot that is stepped asks for the same block a thousand times
def _standard_noise(seed: int, stream: int, block: int, columns: int) -> FloatArray:
    noise = np.random.default_rng([seed, stream, block]).standard_normal((_NOISE_BLOCK, columns))
    noise.setflags(write=False)
    return noise
