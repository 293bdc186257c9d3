"""Table of effects of simulated robots beyond the model file, and the presets `ideal`, `realistic`, `stress`.

A field of `EffectSizes` is a row, and its value is the effect's size. The row states for which parts the effect is drawn and
from which distribution, its size in each preset and the source of that size, how it scales to other robots, and the engines
that support it. Flags, studies, errors and documents follow from the rows. A new effect needs a row here, and its name in
the module that simulates it.

The estimator does not read this table: its priors, with separate sources, are in `estimator/unknowns.py`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np

from equipoise.errors import SettingsError, did_you_mean
from equipoise.robot.scale import Scale
from equipoise.simulation.effect import MUJOCO, ROW, Effect, effect, exact, rms

Noise = Literal["ideal", "realistic", "stress"]
Contacts = Literal["default", "file"]
"""Law of contacts between feet and floor: that of the effects, or that of the model file."""

_JIG = "calibration jigs, by hand"
_BUS = "a sample of a 500 Hz bus is up to 2 ms old"
_SHEET = "data sheets of MEMS sensors"
_FRICTION = "gears of hobby and research quadrupeds"
_SCREWS = "screws, cables, the motors' spread"
_CAD = "CAD without cables"
_WORN = "worn feet, tolerances"
_RUBBER = "rubber"
_MOTORS = "one motor type, one constant: a vendor's bench had real torques of 1/1.3 to 1/1.5 of the reported"


@dataclass(frozen=True)
class EffectSizes:
    """Sizes of a simulated robot's effects: errors of sensors, motors, legs, feet and floor, and a cable.

    The defaults are an ideal robot, as in its model file. Fields, units and meanings are the rows of the table of effects
    (`EffectSizes.rows()`, docs/simulation-studies.md); a size is an rms value, exact, or as the law of its row defines it.
    """

    encoder_noise: float = rms("noise of the encoders", "rad", "joint", _SHEET, realistic=0.3e-3)
    joint_offset: float = rms("encoder reading less joint position", "rad", "joint", _JIG, realistic=5e-3, stress=10e-3)
    joint_velocity_noise: float = rms(
        "noise of the joint velocities", "rad/s", "joint", "encoders, differentiated on the motor boards",
        realistic=0.03,
    )  # fmt: skip
    gyro_noise: float = rms("noise of the gyroscope", "rad/s", "axis", _SHEET, realistic=3e-3)
    gyro_bias: float = rms("bias of the gyroscope, in the IMU frame", "rad/s", "axis", _SHEET, realistic=2e-3)
    accelerometer_noise: float = rms("noise of the accelerometer", "m/s2", "axis", _SHEET, realistic=0.05)
    accelerometer_bias: float = rms(
        "bias of the accelerometer, in the IMU frame", "m/s2", "axis", _SHEET, realistic=0.03,
    )  # fmt: skip
    imu_tilt: float = rms(
        "rotation vector of the IMU in its nominal frame", "rad", "axis", _JIG, realistic=5e-3, stress=10e-3,
    )  # fmt: skip
    torque_noise: float = rms(
        "noise of the reported joint torques", "Nm", "joint", "current sensors", realistic=0.2, measure="torque",
    )  # fmt: skip
    coulomb_friction: float = exact(
        "Coulomb friction of a joint", "Nm", f"{_FRICTION}; half as much again when cold", realistic=0.3, stress=0.45,
        measure="torque",
    )  # fmt: skip
    viscous_friction: float = exact(
        "viscous friction of a joint", "Nm s/rad", f"{_FRICTION}; half as much again when cold", realistic=0.05,
        stress=0.075, measure="torque",
    )  # fmt: skip
    armature: float = exact(
        "rotor inertia seen at a joint", "kg m2", "motors with a gear ratio of six to ten", realistic=0.01,
        measure="torque",
    )  # fmt: skip
    torque_gain: float = rms(
        "true over reported torque, less one", "", "joint", "magnets and windings differ", realistic=0.03,
    )  # fmt: skip
    leg_mass: float = rms(
        "mass, first moment and inertia of a leg link over the model's, less one", "", "joint", _SCREWS, realistic=0.03,
    )  # fmt: skip
    command_delay: float = exact("time from sending a command until it acts", "s", _BUS, realistic=2e-3)
    sensor_delay: float = exact("time from sensing until the time stamp", "s", _BUS, realistic=2e-3)
    imu_clock_offset: float = exact(
        "time by which IMU samples are younger than joint samples of the same stamp", "s", _BUS, realistic=0.5e-3,
        stress=0.0, signed=True,
    )  # fmt: skip
    floor_friction: float = exact(
        "friction coefficient of the floor", "", "rubber on a dusty floor", realistic=0.8, none=1.0, varied=False,
    )  # fmt: skip
    floor_slope: float = effect(
        "angle between gravity and the floor's normal", "rad", "robot", "exact, its direction drawn", "a floor",
        realistic=5e-3,
    )  # fmt: skip

    springs: float = exact(
        "stiffness of the spring between a motor's encoder and the link", "Nm/rad",
        "gear and shank of a 12 kg robot bend by some mrad under 10 Nm; not measured, the lowest estimate",
        stress=3000.0, measure="torque", inverse=True, engines=MUJOCO,
    )  # fmt: skip
    spring_spread: float = effect(
        "stiffness of a joint's spring over that of all", "", "joint", "rms of a factor's logarithm",
        "shanks and gears differ by joint", stress=0.2, engines=MUJOCO,
    )  # fmt: skip
    backlash: float = exact(
        "backlash between a motor's encoder and the link, from stop to stop", "rad", "0.1 deg: a planetary gear",
        stress=float(np.deg2rad(0.1)), engines=MUJOCO,
    )  # fmt: skip
    rotor_spin: float = exact(
        "spin of the rotors in the links that carry them, as a fraction of the armature: one over the gear ratio", "",
        "every geared motor; a ratio of nine", stress=1 / 9, engines=MUJOCO,
    )  # fmt: skip
    friction_spread: float = effect(
        "Coulomb and viscous friction of a joint over those of all", "", "joint", "rms of a factor's logarithm",
        "temperature, seals", stress=0.3,
    )  # fmt: skip
    load_friction: float = exact(
        "friction of a joint over the torque of its motor", "", "teeth under load", stress=0.04,
    )  # fmt: skip
    stribeck: float = exact("Coulomb friction at rest over that in motion, less one", "", "grease at rest", alone=0.3)
    leg_mass_common: float = rms(
        "mass, first moment and inertia of all leg links over the model's, less one", "", "robot",
        f"{_SCREWS}; errors common to all links of a file", stress=0.05,
    )  # fmt: skip
    leg_com_common: float = rms(
        "shift of the CoM of all leg links of a kind", "m", "kind of leg link, three axes", _CAD, stress=4e-3,
        measure="length",
    )  # fmt: skip
    leg_com: float = rms(
        "shift of the CoM of a leg link", "m", "leg link, three axes", _CAD, stress=3e-3, measure="length",
    )  # fmt: skip
    leg_inertia: float = rms(
        "inertia of a leg link about its CoM over that scaled with its mass, less one", "", "joint",
        "solids of one density in CAD", alone=0.1,
    )  # fmt: skip
    leg_length_common: float = rms(
        "length of all thighs or of all calves, less the model's", "m", "kind of leg link", _WORN, stress=0.7e-3,
        measure="length",
    )  # fmt: skip
    leg_length: float = rms(
        "length of a thigh or a calf, less the model's", "m", "joint", _WORN, stress=0.7e-3, measure="length",
    )  # fmt: skip
    hip_position: float = rms(
        "position of a leg's first joint, less the model's, in base axes", "m", "leg, three axes", "tolerances",
        stress=0.7e-3, measure="length",
    )  # fmt: skip
    foot_radius: float = rms(
        "radius of a foot, less the model's", "m", "leg", "rubber wears", stress=1e-3, measure="length",
    )  # fmt: skip
    joint_axes: float = rms(
        "tilt of a joint's axis, about two directions across it", "rad", "joint, two directions", "bores and bearings",
        alone=5e-3,
    )  # fmt: skip
    foot_stiffness: float = exact(
        "stiffness of a foot and the floor under it", "N/m", _RUBBER, stress=30e3, measure="force over length",
        inverse=True, engines=MUJOCO,
    )  # fmt: skip
    rolling_friction: float = exact(
        "rolling friction of a foot: the largest moment over the normal force", "m", f"{_RUBBER}: contact patch",
        stress=0.3e-3, measure="length", engines=MUJOCO,
    )  # fmt: skip
    torsional_friction: float = exact(
        "torsional friction of a foot: the largest moment over the normal force", "m", f"{_RUBBER}: contact patch",
        stress=4e-3, measure="length", engines=MUJOCO,
    )  # fmt: skip
    floor_friction_spread: float = effect(
        "friction coefficient of the floor, less `floor_friction`", "", "robot", "half width",
        "rubber on floors of all kinds", stress=0.2, varied=False,
    )  # fmt: skip
    foothold_height: float = rms(
        "height of the floor under a foot", "m", "leg", "a floor", stress=1e-3, measure="length", engines=MUJOCO,
    )  # fmt: skip
    torque_gain_common: float = rms(
        "true over reported torque of all motors, less one", "", "robot", _MOTORS, stress=0.05,
    )  # fmt: skip
    gyro_gain: float = rms("gyroscope's gain, less one", "", "axis", f"{_SHEET}: 1 to 3 % uncalibrated", stress=5e-3)
    gyro_misalignment: float = rms(
        "share of another axis's rate in the gyroscope's reading", "", "pair of axes", _SHEET, stress=2e-3,
    )  # fmt: skip
    gyro_turn: float = rms(
        "rotation vector of the gyroscope in the accelerometer's frame", "rad", "axis", _SHEET, stress=5e-3,
    )  # fmt: skip
    imu_position: float = rms(
        "position of the IMU, less the model's, in base axes", "m", "axis", "boards and drawings", alone=2e-3,
    )  # fmt: skip
    accelerometer_gain: float = rms(
        "accelerometer's gain, less one", "", "axis", f"{_SHEET}: 0.3 to 1 % uncalibrated", stress=3e-3,
    )  # fmt: skip
    gyro_drift: float = rms(
        "change of the gyroscope's bias in two minutes", "rad/s", "axis", "an IMU that warms up", alone=2e-3,
    )  # fmt: skip
    imu_filter: float = exact(
        "cut-off frequency of the IMU's low pass, a Butterworth filter of second order", "Hz", "on-board filters",
        stress=100.0, inverse=True,
    )  # fmt: skip
    imu_latency: float = exact(
        "time by which IMU samples are older than joint samples of the same stamp", "s", "on-board filters",
        stress=2e-3,
    )  # fmt: skip
    sample_rate: float = exact(
        "sample rate; without it, one sample per control period", "Hz", "logs and buses of 100 to 200 Hz", alone=200.0,
        inverse=True,
    )  # fmt: skip
    jitter: float = rms("time stamp of a sample minus its read time", "s", "robot", "DDS, UDP", stress=0.2e-3)
    lost_samples: float = exact(
        "share of the samples that are lost", "", "DDS, UDP", stress=3e-3,
        most=(0.5, "control loops need more samples"),
    )  # fmt: skip
    encoder_eccentricity: float = effect(
        "amplitude of an encoder's error over a turn of the joint", "rad", "joint", "exact, its direction drawn",
        "an eccentric encoder magnet", alone=3e-3,
    )  # fmt: skip
    cable: float = effect(
        "constant horizontal force on the base, in a direction that is fixed in the room", "N", "robot",
        "exact, its direction drawn", "half a metre of Ethernet", stress=0.15,
    )  # fmt: skip
    swinging_load: float = exact(
        "mass of a load that swings under the base, on a string of 0.1 m, scaled by the robot's length over an A1's",
        "kg", "a plug, a lanyard", alone=0.1, measure="mass", engines=MUJOCO,
    )  # fmt: skip
    sling: float = exact(
        "stiffness of a safety sling above the base, 5 mm slack at the stance, scaled by the robot's length over an A1's",
        "N/m", "a crane that is not lowered far enough", alone=1e3, measure="force over length", engines=MUJOCO,
        varied=False,
    )  # fmt: skip
    foot_width: float = exact(
        "half width of feet that are cylinders across the leg", "m", "feet of rubber hose or of printed plates",
        alone=6e-3, measure="length", engines=MUJOCO, varied=False,
    )  # fmt: skip
    foot_oval: float = exact(
        "fore-aft radius of curvature of a foot's bottom over its radius, less one; the lateral one falls by half as much",
        "", "rubber that wore on two sides", alone=0.3, most=(1.0, "the foot would be a blade"), engines=MUJOCO,
        varied=False,
    )  # fmt: skip
    foot_flat: float = exact(
        "half width of the flat at a foot's bottom, a disc that is level at the stance", "m",
        "rubber that wore where it stands", alone=3e-3, measure="length", engines=MUJOCO, varied=False,
    )  # fmt: skip
    foot_position: float = rms(
        "position of a foot, less the model's, along the calf and in two directions across it", "m", "leg, three axes",
        "feet that were replaced: 3 mm in all", alone=1.7e-3, measure="length",
    )  # fmt: skip
    gyro_lag: float = exact(
        "time by which gyroscope samples are older than accelerometer samples of the same stamp", "s",
        "separate filters inside an IMU: 2 to 4 ms", alone=4e-3,
    )  # fmt: skip
    vertical_pull: float = exact(
        "vertical force on the base above the rear feet, upward where positive", "N",
        "a cable that hangs down or comes from above", alone=-3.0, measure="force", signed=True, engines=MUJOCO,
    )  # fmt: skip
    hose: float = exact(
        "stiffness of a hose that pulls the point of the base above the rear feet back to its position at the stance",
        "N/m", "hoses and thick cables: 10 to 20 N/m", alone=20.0, measure="force over length", engines=MUJOCO,
    )  # fmt: skip
    slosh: float = exact(
        "share of the payload that moves as water in a tank does, 2.2 Hz on an A1", "", "tanks half full", alone=0.65,
        most=(0.9, "the tank itself has a mass"), engines=MUJOCO, varied=False,
    )  # fmt: skip

    def __post_init__(self) -> None:
        for row in self.rows():
            value = getattr(self, row.name)
            if not (np.isfinite(value) and (value >= 0 or row.signed)):
                least = "" if row.signed else ", zero or more"
                raise SettingsError(f"{row.name} is {value}; it must be a finite number{least}")
            if value > row.most[0]:
                raise SettingsError(f"{row.name} is {value}: {row.most[1]}; give {row.most[0]:g} at most")
        if self.imu_clock_offset > self.sensor_delay:
            raise SettingsError(
                f"imu_clock_offset is {self.imu_clock_offset} s and sensor_delay is {self.sensor_delay} s: IMU samples would "
                "be taken after they are read; increase sensor_delay, or reduce imu_clock_offset"
            )

    @classmethod
    @cache
    def rows(cls) -> tuple[Effect, ...]:
        """Return the table of effects."""
        return tuple(dataclasses.replace(row.metadata[ROW], name=row.name) for row in dataclasses.fields(cls))

    @classmethod
    def row(cls, name: str) -> Effect:
        """Return the row of a name; raise SettingsError if it does not exist."""
        rows = {row.name: row for row in cls.rows()}
        if name not in rows:
            raise SettingsError(
                f"{name!r} is not an effect of a simulated robot; {did_you_mean(name, rows)}the effects are {', '.join(rows)}"
            )
        return rows[name]

    def scaled_to(self, scale: Scale) -> EffectSizes:
        """Return an A1's effects scaled to a robot of another size, each by the measure of its row."""
        return dataclasses.replace(
            self, **{r.name: r.scaled(getattr(self, r.name), scale) for r in self.rows() if r.measure}
        )

    def with_effects(self, effects: Mapping[str, float | None], scale: Scale) -> EffectSizes:
        """Return the sizes with these effects added, or of other sizes.

        Args:
            effects: size by name, not scaled; None: the size when it is simulated alone, on a robot of that scale.
            scale: scale of the robot.

        Raises:
            SettingsError: the effect is unknown, or the size is invalid.
        """
        rows = {name: self.row(name) for name in effects}
        usual = {name: row.scaled(row.size_alone, scale) for name, row in rows.items()}
        return dataclasses.replace(self, **{n: usual[n] if size is None else size for n, size in effects.items()})

    def without_effects(self, names: Iterable[str]) -> EffectSizes:
        """Return the sizes without these effects; raise SettingsError for an unknown name."""
        return dataclasses.replace(self, **{name: self.row(name).none for name in names})

    def times(self, factors: Mapping[str, float]) -> EffectSizes:
        """Return the sizes with each of these effects multiplied by its factor, by name."""
        rows = {name: self.row(name) for name in factors}
        return dataclasses.replace(self, **{n: rows[n].times(getattr(self, n), factors[n]) for n in factors})

    def check_supported_by(self, engine: str) -> None:
        """Raise SettingsError for effects that an engine does not support."""
        lacking = [r.name for r in self.rows() if engine not in r.engines and getattr(self, r.name) != r.none]
        if lacking:
            raise SettingsError(
                f"{engine} does not support the effects {', '.join(lacking)}; disable them (--disable-effect "
                f"{','.join(lacking)}) or use {self.row(lacking[0]).engines[0]}"
            )


def read_effects(texts: Iterable[str]) -> dict[str, float | None]:
    """Read effects with their sizes from "springs=3000,cable"; None: no size is given.

    Raises:
        SettingsError: the effect is unknown, or the size is not a number.
    """
    read: dict[str, float | None] = {}
    for word in read_names(texts):
        name, given, size = (part.strip() for part in word.partition("="))
        unit = EffectSizes.row(name).unit or "a fraction"
        try:
            read[name] = float(size) if given else None
        except ValueError:
            raise SettingsError(
                f"{word!r} does not give {name} a size; give a number ({unit}), for example {name}=0.1"
            ) from None
    return read


def read_names(texts: Iterable[str]) -> tuple[str, ...]:
    """Return the words between commas."""
    return tuple(word.strip() for text in texts for word in text.split(",") if word.strip())


IDEAL = EffectSizes()
"""No noise, no bias, no joint friction, exact leg model; a floor with friction coefficient 1."""

REALISTIC = EffectSizes(**{row.name: row.realistic for row in EffectSizes.rows()})
"""Sizes of an A1; `EffectSizes.scaled_to` scales them to other robots."""

STRESS = EffectSizes(**{row.name: row.in_stress for row in EffectSizes.rows()})
"""Effects of ordinary robots all at once, on an A1; more than the estimator models."""

PRESETS: dict[Noise, EffectSizes] = {"ideal": IDEAL, "realistic": REALISTIC, "stress": STRESS}


def sizes_of(
    noise: Noise | EffectSizes, scale: Scale, effects: Mapping[str, float | None], disabled: Sequence[str]
) -> EffectSizes:
    """Return the sizes of a robot's effects; arguments are those of `simulate`.

    Raises:
        SettingsError: the preset or the effect does not exist, or an effect is both enabled and disabled.
    """
    if isinstance(noise, str) and noise not in PRESETS:
        raise SettingsError(f"preset {noise!r} does not exist; use one of {', '.join(PRESETS)}, or EffectSizes")
    if both := set(effects) & set(disabled):
        raise SettingsError(f"{', '.join(sorted(both))}: both enabled and disabled; use one of the two options")
    sizes = PRESETS[noise].scaled_to(scale) if isinstance(noise, str) else noise
    return sizes.with_effects(effects, scale).without_effects(disabled) if effects or disabled else sizes
