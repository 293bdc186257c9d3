"""The table of unknowns: what the Bayesian method takes to be unknown beside the base, and what it believes beforehand.

A field of `Priors` is a row. Its value is the standard deviation of the prior, a setting; the rest of the row says what one
is per robot, its unit, where the prior comes from, what a report calls it and advises, and what becomes of it between two
runs. Layout, priors, columns of the Jacobian, findings, checks, the estimate of two runs and the documents follow from it.
A new unknown is a row here, and its name in the equation that it enters: `values["name"]`, and in what the equation says it
depends on. Its derivatives follow from the equation (traced.py). What a row is, is in unknown.py.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import SettingsError, did_you_mean
from equipoise.estimator.measurements.traced import Traced
from equipoise.estimator.unknown import (
    A1_TORQUE,
    AXIS,
    CABLE,
    FEET,
    FLOOR,
    HIP_AXIS,
    HIP_HEIGHT,
    IMU,
    JOINT,
    JOINT_KIND,
    JOINT_PHASE,
    JOINTS,
    KIND_AXIS,
    LEG,
    LEG_LENGTHS,
    LEG_LINK,
    LEG_MASSES,
    LENGTH,
    LENGTH_KIND,
    LINK_AXIS,
    MOTORS,
    PER_A1_STIFFNESS,
    PER_A1_TORQUE,
    ROBOT,
    ROW,
    Unknown,
    named,
    unknown,
)
from equipoise.user_file import read_text, toml_table

if TYPE_CHECKING:
    from equipoise.robot.model import RobotModel

Values = Mapping[str, FloatArray]
"""Value of every unknown, an array each, by its row's name and in its row's unit; zero is what the model says."""

TracedValues = Mapping[str, Traced]
"""The same in an equation of n samples, (size, n) each: a value is laid out once for every sample."""

_REALISTIC = "assumed; what the simulation's `realistic` sensors have"
_DEGREES = math.degrees(1.0)


@dataclass(frozen=True)
class Priors:
    """Standard deviations of what is believed before anything is measured; all of mean zero (or of the model's value).

    The first three are of the base and the whole robot; all others are rows of the table of unknowns, in its order. Zero holds
    such a row at the model's value, for those who know better.

    Attributes:
        mass: mass of the whole robot, as a fraction of the model's. A payload of half the robot's mass is two of these.
        first_moment: first moment of the base, over the model's base mass times the hip height.
        inertia: inertia of the base about its origin, over the model's largest moment.
    """

    mass: float = 0.3
    first_moment: float = 0.3
    inertia: float = 2.0
    leg_mass: float = unknown(
        0.05, "mass, first moment and inertia of a leg link over the model's, less one, beside the common part", "", LEG_LINK,
        "assumed; the simulation's `realistic` legs have 0.03",
        group=LEG_MASSES, label="mass of the link that {each} moves",
        cause="legs weigh what the file does not say, one more than the other",
    )  # fmt: skip
    leg_mass_common: float = unknown(
        0.1, "the same of all leg links in common", "", ROBOT, "assumed: files of the same robot differ by that much",
        group=LEG_MASSES, label="mass of all leg links",
        cause="the legs weigh more or less than in the file", opened_by="--leg-prior wide",
    )  # fmt: skip
    link_com: float = unknown(
        0.011, "CoM of a leg link less the model's, beside the common part: down the link, forward, along the joint's axis",
        "m", LINK_AXIS, "assumed: CAD without cables; 3 mm on an A1",
        group=LEG_MASSES, measure=HIP_HEIGHT, label="CoM of the link of {each}",
        cause="masses in the legs sit elsewhere than in the file", opened_by="--leg-prior wide",
    )  # fmt: skip
    link_com_common: float = unknown(
        0.015, "the same of all links of one kind in common: down the link, forward", "m", KIND_AXIS,
        "assumed: CAD without cables; 4 mm on an A1",
        group=LEG_MASSES, measure=HIP_HEIGHT, label="CoM of all links of one kind, {each}",
        cause="masses in the legs sit elsewhere than in the file, in all legs alike", opened_by="--leg-prior wide",
    )  # fmt: skip
    joint_offset: float = unknown(
        5e-3, "encoder reading less joint position", "rad", JOINT, _REALISTIC,
        group=JOINTS, label="joint offset of {each}", finding="{each} offset", shown=_DEGREES, significant=4e-3, switched=0.1,
        advice="{each}: the encoder's zero is off by {value:+.2f} deg (sd {std:.2f})",
        cause="encoders do not read zero where the model has it",
    )  # fmt: skip
    compliance: float = unknown(
        5e-4, "angle by which a link of one kind lags behind its encoder, over the joint's torque", "rad/Nm", JOINT_KIND,
        "assumed: springs of 2000 Nm/rad; no bench of an A1 or Go2 is known", group=JOINTS, measure=PER_A1_TORQUE,
        label="compliance of the {each} joints", finding="{each} compliance", shown=1000.0, significant=2e-4, judged=False,
        nonnegative=True,
        advice="the {each} joints give by {value:.2f} mrad per Nm (sd {std:.2f})",
        advice_below="the compliance of the {each} joints is not measurable: {value:.2f} mrad/Nm (std {std:.2f})",
        cause="joints give under load: springs in gears or shanks",
    )  # fmt: skip
    backlash: float = unknown(
        2e-3, "angle that a joint of one kind is free to turn in its gear", "rad", JOINT_KIND,
        "data sheets of gears: 0.05 to 0.25 deg", group=JOINTS, label="backlash of the {each} joints",
        finding="{each} backlash",
        shown=_DEGREES, significant=2e-3, judged=False, nonnegative=True,
        advice="the {each} joints have a backlash of {value:.2f} deg (sd {std:.2f})",
        advice_below="the backlash of the {each} joints is not measurable: {value:.2f} deg (std {std:.2f})",
        cause="joints have backlash in their gears",
    )  # fmt: skip
    eccentricity: float = unknown(
        2e-3, "encoder's error that goes with the sine and with the cosine of its reading", "rad", JOINT_PHASE,
        "assumed: a magnet beside its axis", group=JOINTS, label="eccentricity of {each}",
        cause="encoders err over a turn of their joints: a magnet beside its axis, or an axis askew",
    )  # fmt: skip
    imu_tilt: float = unknown(
        6e-3, "rotation vector of the IMU in the frame where it should be", "rad", named("roll", "pitch", "yaw"),
        "assumed; the simulation's `realistic` sensors have 5 mrad",
        group=IMU, label="IMU tilt in {each}", finding="IMU {each}ed", shown=_DEGREES, significant=4e-3,
        advice="the IMU is {each}ed by {value:+.2f} deg (sd {std:.2f})",
        cause="the IMU is mounted askew",
    )  # fmt: skip
    imu_position: float = unknown(
        2e-3, "position of the accelerometer less the model's, in base axes with x forward", "m", AXIS,
        "assumed: boards and drawings; a file that has it at the base's origin may just not know",
        group=IMU, otherwise=0.1,
        label="position of the IMU along {each}", finding="IMU position {each}", shown=1000.0, significant=4e-3,
        advice="the IMU sits {value:+.1f} mm further along {each} than in the file (sd {std:.1f})",
        cause="the IMU sits elsewhere than in the file",
    )  # fmt: skip
    accelerometer_bias: float = unknown(
        0.03, "accelerometer reading less specific force, in the IMU frame", "m/s2", AXIS, _REALISTIC,
        group=IMU, label="accelerometer bias {each}", finding="accelerometer bias {each}", significant=0.05, drift=0.2,
        advice="the accelerometer's {each} reads {value:+.3f} m/s2 too much (sd {std:.3f})",
        cause="the accelerometer reads too much or too little at rest",
    )  # fmt: skip
    accelerometer_gain: float = unknown(
        5e-3, "accelerometer reading less its bias over specific force along each axis, less one", "", AXIS,
        "data sheets of MEMS accelerometers: 0.3 to 1 %",
        group=IMU, label="accelerometer gain {each}", finding="accelerometer gain {each}", significant=0.01, drift=0.1,
        advice="the accelerometer's {each} axis reads {value:+.2%} too much (sd {std:.2%})",
        cause="the accelerometer's axes have other gains",
    )  # fmt: skip
    accelerometer_drift: float = unknown(
        0.03, "change of the accelerometer's bias from the run's begin to its end", "m/s2", AXIS, "an IMU that warms up",
        group=IMU, label="drift of the accelerometer's {each}", drift=None,
        cause="the accelerometer's bias drifts: an IMU that warms up, wait until it is warm",
    )  # fmt: skip
    gyro_drift: float = unknown(
        2e-3, "change of the gyroscope's bias from the run's begin to its end", "rad/s", AXIS, "an IMU that warms up",
        group=IMU, label="drift of the gyroscope's {each}", drift=None,
        cause="the gyroscope's bias drifts: an IMU that warms up, wait until it is warm",
    )  # fmt: skip
    gyro_gain: float = unknown(
        0.01, "angular velocity read less the true one along each axis, over what is read", "", AXIS,
        "data sheets of MEMS gyroscopes: 1 to 3 % as they come, 0.3 to 1 % calibrated",
        group=IMU, label="gyroscope gain {each}", finding="gyroscope gain {each}", significant=0.02, drift=0.1,
        advice="the gyroscope's {each} axis reads {value:+.2%} too much (sd {std:.2%})",
        cause="the gyroscope's axes have other gains",
    )  # fmt: skip
    gyro_misalignment: float = unknown(
        6e-3, "angular velocity about one axis that another axis reads, over itself", "rad",
        named("x of y", "x of z", "y of x", "y of z", "z of x", "z of y"),
        "assumed; data sheets: 2 mrad between the axes, 5 mrad against the accelerometer",
        group=IMU, label="gyroscope misalignment, {each}", drift=0.1,
        cause="the gyroscope's axes are not where the accelerometer's are",
    )  # fmt: skip
    clock_offset: float = unknown(
        2e-3, "time by which an IMU sample is younger than a joint sample of the same stamp", "s", ROBOT,
        "assumed; a sample of a 500 Hz bus is up to 2 ms old, and an IMU's filter as late",
        group=IMU, label="clock offset", finding="clock offset", shown=1000.0, significant=1e-3, drift=None,
        advice="IMU samples are {size:.2f} ms younger than joint samples of the same stamp",
        advice_below="IMU samples are {size:.2f} ms older than joint samples of the same stamp",
        cause="samples of IMU and joints are not as old as each other: a filter or a bus delays one",
    )  # fmt: skip
    gyro_lag: float = unknown(
        2e-3, "age of a gyroscope sample less that of the accelerometer sample of the same stamp", "s", ROBOT,
        "data sheets: filters of 5 to 50 Hz of the two differ by 1 to 4 ms",
        group=IMU, label="lag of the gyroscope", finding="lag of the gyroscope", shown=1000.0, significant=1e-3, drift=None,
        advice="gyroscope samples are {size:.2f} ms older than accelerometer samples of the same stamp",
        advice_below="gyroscope samples are {size:.2f} ms younger than accelerometer samples of the same stamp",
        cause="the gyroscope's samples are not as old as the accelerometer's: their filters differ",
    )  # fmt: skip
    foot_radius: float = unknown(
        0.02, "radius of all feet over the model's, less one", "", ROBOT, "assumed; rubber wears and gives",
        group=LEG_LENGTHS, label="foot radius", finding="foot radius", significant=0.03,
        advice="the feet roll as if their radius were {value:+.1%} off the model's",
        cause="the feet are larger or smaller than in the file, or soft",
    )  # fmt: skip
    foot_width: float = unknown(
        0.01, "half-width of the feet beyond that of balls, across and along the legs", "m", named("across", "along"),
        "assumed: 3 mm on an A1, or what the file's feet have; worn feet a few millimetres", group=LEG_LENGTHS, measure=FEET,
        label="half-width of the feet {each} the legs", finding="half-width of the feet {each}", shown=1000.0,
        significant=2e-3,
        drift=0.1, judged=False, nonnegative=True,
        advice="the feet are no balls: they stand on their edges {value:+.1f} mm {each} the legs (sd {std:.1f})",
        advice_below="the feet's width {each} the legs is not measurable: {value:.1f} mm (sd {std:.1f})",
        cause="the feet are wide, as cylinders, or worn flat",
    )  # fmt: skip
    rolling_resistance: float = unknown(
        2e-2, "moment by which feet resist rolling, over the weight on them", "m", ROBOT,
        "wide: rubber has 0.3 to 1 mm; contact models of vendors up to 10 mm", group=FLOOR, measure=HIP_HEIGHT,
        label="rolling resistance of the feet", finding="rolling resistance", shown=1000.0, significant=1e-3, drift=0.5,
        judged=False, nonnegative=True,
        advice="the feet resist rolling as if carried {value:+.2f} mm off their centres (sd {std:.2f})",
        advice_below="the rolling resistance of the feet is not measurable: {value:.2f} mm (std {std:.2f})",
        cause="the feet resist rolling: soft rubber or a soft floor",
    )  # fmt: skip
    foot_radius_each: float = unknown(
        0.05, "the same of each foot, beside the common part", "", LEG, "assumed: 1 mm on an A1; worn feet",
        group=LEG_LENGTHS, label="foot radius of {each}",
        cause="some feet are larger or smaller than in the file: worn, or soft", opened_by="--leg-prior wide",
    )  # fmt: skip
    foot_compliance: float = unknown(
        5e-5, "length by which a foot and the floor under it give, over the load on the foot", "m/N", ROBOT,
        "assumed: rubber of 20 kN/m; no bench of an A1 or Go2 is known", group=FLOOR, measure=PER_A1_STIFFNESS,
        label="foot compliance", finding="foot compliance", shown=1e5, significant=2e-5, drift=0.5, judged=False,
        nonnegative=True,
        advice="the feet, or the floor, sag by {value:.1f} mm per 100 N (sd {std:.1f})",
        advice_below="the compliance of the feet is not measurable: {value:.1f} mm per 100 N (std {std:.1f})",
        cause="the feet or the floor give under load: soft rubber or a soft floor",
    )  # fmt: skip
    link_length: float = unknown(
        0.0026, "length of a thigh or calf less the model's, beside the common part", "m", LENGTH,
        "0.7 mm on an A1: tolerances",
        group=LEG_LENGTHS, otherwise=0.02, measure=HIP_HEIGHT, label="length of {each}",
        cause="thighs or calves are longer or shorter than in the file", opened_by="--leg-prior wide",
    )  # fmt: skip
    link_length_common: float = unknown(
        0.0037, "the same of all thighs, and of all calves, in common", "m", LENGTH_KIND, "assumed: 1 mm on an A1; worn feet",
        group=LEG_LENGTHS, otherwise=0.1, measure=HIP_HEIGHT, label="length of all {each}",
        finding="length of the {each}", shown=1000.0,
        significant=2e-3,
        advice="the {each} are longer than the model's by {value:+.1f} mm (sd {std:.1f})",
        cause="thighs or calves are longer or shorter than in the file, in all legs alike", opened_by="--leg-prior wide",
    )  # fmt: skip
    hip_position: float = unknown(
        0.0026, "place of a leg's first joint less the model's, in the base frame", "m", HIP_AXIS,
        "0.7 mm on an A1: tolerances",
        group=LEG_LENGTHS, otherwise=0.1, measure=HIP_HEIGHT, label="hip position {each}",
        cause="hips sit elsewhere than in the file", opened_by="--leg-prior wide",
    )  # fmt: skip
    external_force: float = unknown(
        0.2, "constant horizontal force on the base, forward and to its left at the run's beginning: a cable", "N",
        named("forward", "left"),
        "half a metre of Ethernet cable, at robots of any size; none is known without one",
        group=CABLE, label="pull {each}", drift=None,
        cause="it pulls to one side: a cable or a hand?", opened_by="--cable light",
    )  # fmt: skip
    hanging_load: float = unknown(
        0.08, "moment about the base's origin of what hangs from the base, about its forward and left axes", "Nm",
        named("forward", "left"),
        "half a metre of Ethernet cable, 0.2 N, at the end of a trunk; none is known without one",
        group=CABLE, measure=HIP_HEIGHT, label="moment of a hanging cable about {each}", drift=None,
        cause="something hangs from it: a cable, a hose", opened_by="--cable light",
    )  # fmt: skip
    tether_stiffness: float = unknown(
        10.0, "stiffness of a tether between the end of the trunk and where that is at the nominal stance", "N/m", ROBOT,
        "a hose has 10 to 20; none is known without one",
        group=CABLE, label="stiffness of a tether", finding="stiffness of a tether", significant=5.0, drift=None, judged=False,
        nonnegative=True,
        advice="something holds the trunk back to its place with {value:.1f} N/m (sd {std:.1f}): a hose or a tether",
        advice_below="the stiffness of a tether is not measurable: {value:.1f} N/m (sd {std:.1f})",
        cause="a hose or a tether holds the trunk back", opened_by="--cable light",
    )  # fmt: skip
    floor_slope: float = unknown(
        5e-3, "floor's normal less up, in base axes at the nominal stance and the run's beginning", "rad", named("x", "y"),
        _REALISTIC,
        group=FLOOR, label="floor slope along {each}", finding="floor slope {each}", shown=_DEGREES, significant=8e-3,
        drift=None,
        advice="the floor leans along {each} by {value:+.2f} deg (sd {std:.2f})",
        cause="the floor leans",
    )  # fmt: skip
    floor_warp: float = unknown(
        1e-3, "height of two diagonal footholds above the mean of all four", "m", ROBOT, "assumed; an indoor floor",
        group=FLOOR, measure=HIP_HEIGHT, label="floor warp", drift=None, judged=False,
        cause="the four footholds are in no plane",
    )  # fmt: skip
    foothold_change: float = unknown(
        0.0037, "height of a foothold after the robot was turned above what slope and warp make it", "m", LEG,
        "assumed: 1 mm on an A1, an indoor floor; held where nobody turns the robot", group=FLOOR, measure=HIP_HEIGHT,
        label="height of the new foothold of {each}", drift=None, judged=False,
        cause="the footholds after the turn are in no plane with those before",
    )  # fmt: skip
    torque_gain_common: float = unknown(
        0.2, "true over reported torque of all joints, less one", "", ROBOT,
        "one motor type, one torque constant; a vendor's bench: the true one is 1/1.3 to 1/1.5 of what is reported",
        group=MOTORS, label="torque gain of all joints", finding="torque gain", significant=0.05, drift=0.1,
        advice="true joint torques are {value:+.1%} off the reported ones (sd {std:.1%})",
        cause="the reported torques are not those at the joints",
    )  # fmt: skip
    torque_gain: float = unknown(
        0.03, "the same of each joint, beside the common part", "", JOINT, _REALISTIC,
        group=MOTORS, label="torque gain of {each}", finding="{each} torque gain", significant=0.05, drift=0.1,
        advice="{each}: the true torque is {value:+.1%} off the reported one (sd {std:.1%})",
        cause="the reported torques are not those at the joints, in some more than in others",
    )  # fmt: skip
    coulomb_friction: float = unknown(
        0.5, "Coulomb friction of every joint", "Nm", ROBOT, "wide: the simulation's `realistic` joints have 0.3",
        group=MOTORS, measure=A1_TORQUE, label="Coulomb friction", finding="Coulomb friction of the joints", drift=0.2,
        judged=False,
        nonnegative=True,
        advice="Coulomb friction of the joints: {value:.3f} Nm",
        cause="the joints have friction",
    )  # fmt: skip
    rotor_spin: float = unknown(
        1.5e-3, "angular momentum of a joint's rotor over the joint's velocity: its inertia times the gear ratio", "kg m2",
        ROBOT, "assumed: 0.01 kg m2 at the joint, over gear ratios of 6 to 10", group=MOTORS, measure=A1_TORQUE,
        label="spin of the rotors",
        cause="the motors' rotors spin",
    )  # fmt: skip
    viscous_friction: float = unknown(
        0.1, "viscous friction of every joint", "Nm s/rad", ROBOT, "wide: the simulation's `realistic` joints have 0.05",
        group=MOTORS, measure=A1_TORQUE, label="viscous friction", finding="viscous friction of the joints", drift=0.2,
        judged=False,
        nonnegative=True,
        advice="viscous friction of the joints: {value:.3f} Nm s/rad",
        cause="the joints have friction that grows with speed",
    )  # fmt: skip
    armature: float = unknown(
        0.02, "rotor inertia seen at every joint", "kg m2", ROBOT, "wide: the simulation's `realistic` joints have 0.01",
        group=MOTORS, measure=A1_TORQUE, label="armature", finding="armature of the joints", judged=False, nonnegative=True,
        advice="armature of the joints: {value:.3f} kg m2",
        cause="the rotors have inertia",
    )  # fmt: skip

    def __post_init__(self) -> None:
        rows = {row.name for row in self.rows()}
        for prior in fields(self):
            value = getattr(self, prior.name)
            if not (0 < value < math.inf or (value == 0 and prior.name in rows)):
                least = "zero, which holds it, or more" if prior.name in rows else "above zero"
                raise SettingsError(f"the prior of {prior.name} is {value}; it must be {least}, and finite")

    def holding(self, *names: str) -> Priors:
        """The same, with some rows held at the model's values."""
        return replace(self, **dict.fromkeys(names, 0.0))

    @property
    def all_open(self) -> Priors:
        """The same, with no row held."""
        held = (row for row in self.rows() if getattr(self, row.name) == 0)
        return replace(self, **{row.name: row.usual for row in held})

    @classmethod
    def read(cls, path: Path) -> Priors:
        """From a TOML file of numbers by name; what is not in it is as usual.

        Raises:
            SettingsError: there is no such file, it is no TOML, or a name or number in it is none.
        """
        try:
            table = toml_table(read_text(path))
        except (OSError, ValueError) as error:
            raise SettingsError(f"cannot read priors from {path}: {error}") from error
        known = {field.name: field for field in fields(cls)}
        for name, value in table.items():
            if name not in known:
                raise SettingsError(
                    f"{path}: {name!r} is no unknown; {did_you_mean(name, known)}those are {', '.join(known)}"
                )
            if not isinstance(value, int | float) or isinstance(value, bool):
                raise SettingsError(f"{path}: the prior of {name} is {value!r}; it must be a number")
        return cls(**{name: float(value) for name, value in table.items()})

    @property
    def estimated(self) -> tuple[Unknown, ...]:
        """The rows that are not held."""
        return tuple(row for row in self.rows() if getattr(self, row.name) > 0)

    @property
    def not_of_this_robot(self) -> tuple[Unknown, ...]:
        """Rows that are believed as nobody's number is."""
        return tuple(row for row in self.rows() if row.otherwise and getattr(self, row.name) == row.otherwise)

    @classmethod
    def rows(cls) -> tuple[Unknown, ...]:
        """The table of unknowns."""
        return tuple(replace(row.metadata[ROW], name=row.name) for row in fields(cls) if ROW in row.metadata)

    @classmethod
    def row(cls, name: str) -> Unknown:
        """The row of a name."""
        return next(row for row in cls.rows() if row.name == name)


def by_the_model(robot: RobotModel) -> dict[str, FloatArray]:
    """`Values` of a robot that is as its model says, with perfect sensors on a level floor: all zero."""
    return {row.name: np.zeros(len(row.each.labels(robot))) for row in Priors.rows()}


def inputs_of(values: Values, names: Sequence[str], count: int, by: Sequence[str] = ()) -> TracedValues:
    """Some values as inputs of an equation of so many samples; it can read no others.

    Args:
        values: (size,) values of all samples alike, or (size, count) values of each.
        by: names of those that derivatives are taken by.
    """

    def laid_out(name: str) -> Traced:
        given = values[name]
        value = np.broadcast_to(given if given.ndim == 2 else given[:, None], (len(given), count))
        return Traced.input(value) if name in by else Traced(value)

    return {name: laid_out(name) for name in names}


def finding_names(robot: RobotModel, name: str) -> list[str]:
    """What the findings about an unknown are called, one of each; `name` is that of its row."""
    row = Priors.row(name)
    return [row.finding.format(each=label) for label in row.each.labels(robot)]
