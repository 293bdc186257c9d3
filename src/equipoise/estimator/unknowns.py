"""Parameter table of the Bayesian method: all parameters except the base's, with their priors.

A field of `Priors` is a row (`Unknown`). Its value, a setting, is the prior's standard deviation as a multiple of the row's
measure (such as the hip height). The row also holds the unit, the source of the prior, names and messages for reports, and
the change between two runs. Layout, priors, Jacobian columns, findings, checks, the estimate of two runs and the documents
follow from the table.

To add a parameter, add a row here, and use `values["name"]` in its equation, which lists the name in `depends_on`. Its
derivatives follow from the equation (traced.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import SettingsError, did_you_mean
from equipoise.estimator.measurements.traced import Traced
from equipoise.user_file import read_text, toml_table

if TYPE_CHECKING:
    from equipoise.robot.model import RobotModel
    from equipoise.robot.stance import Stance

Values = Mapping[str, FloatArray]
"""Array of values of every row, by name and in the row's unit; zero is the model's value."""

TracedValues = Mapping[str, Traced]
"""Values in an equation of n samples, (size, n) each: a value is repeated for every sample."""

ROW = "unknown"


@dataclass(frozen=True)
class Each:
    """Parts of a robot that have one parameter of a row each.

    Attributes:
        name: name of such a part in prose.
        labels: function that gives the names of all of them, for a robot.
    """

    name: str
    labels: Callable[[RobotModel], tuple[str, ...]]


@dataclass(frozen=True)
class Measure:
    """Quantity that scales a prior to the size of a robot.

    Attributes:
        name: name in prose.
        of: function that gives its value in the parameter's unit.
    """

    name: str
    of: Callable[[RobotModel, Stance], float]


def named(*labels: str) -> Each:
    """Return parts with the same names on any robot."""
    return Each(", ".join(labels), lambda robot: labels)


def _link_joints(robot: RobotModel) -> tuple[str, ...]:
    return tuple(robot.joint_names[joint] for leg in robot.legs.values() for joint in leg.joints)


def _kinds(robot: RobotModel) -> tuple[str, ...]:
    return ("hip", "thigh", "calf")[-robot.leg_joints.shape[1] :]


ROBOT = Each("robot", lambda robot: ("",))
JOINT = Each("joint", lambda robot: tuple(robot.joint_names))
JOINT_PHASE = Each(
    "joint and phase",
    lambda robot: tuple(f"{name}, {phase}" for name in robot.joint_names for phase in ("sine", "cosine")),
)
LEG = Each("leg", lambda robot: tuple(robot.legs))
LENGTH = Each(
    "thigh and calf", lambda robot: tuple(f"{leg} {link}" for leg in robot.legs for link in ("thigh", "calf"))
)
LENGTH_KIND = named("thighs", "calves")
HIP_AXIS = Each("leg and axis", lambda robot: tuple(f"{leg} {axis}" for leg in robot.legs for axis in "xyz"))
LINK_AXIS = Each(
    "leg link and direction",
    lambda robot: tuple(f"{name}, {axis}" for name in _link_joints(robot) for axis in ("down", "forward", "across")),
)
KIND_AXIS = Each(
    "kind of link and direction",
    lambda robot: tuple(f"{kind}, {axis}" for kind in _kinds(robot) for axis in ("down", "forward")),
)
LEG_LINK = Each("leg link, by the joint that moves it", _link_joints)
JOINT_KIND = Each("kind of joint: hip, thigh, calf", _kinds)
AXIS = named("x", "y", "z")

ITSELF = Measure("", lambda robot, stance: 1.0)
FEET = Measure(
    "hip height, or a hundred half-widths of the file's feet",
    lambda robot, stance: max(stance.hip_height, *(100 * leg.foot_half_width for leg in robot.legs.values())),
)
HIP_HEIGHT = Measure("hip height", lambda robot, stance: stance.hip_height)
PER_A1_TORQUE = Measure("an A1's m g h over m g h", lambda robot, stance: 1.0 / stance.scale.torque)
PER_A1_STIFFNESS = Measure(
    "an A1's m g / h over m g / h", lambda robot, stance: stance.scale.length**2 / stance.scale.torque
)
A1_TORQUE = Measure("m g h over an A1's", lambda robot, stance: stance.scale.torque)


MORE_TIME, USE_SCALE = "more robot time (--duration)", "a scale (--mass)"


@dataclass(frozen=True)
class Group:
    """Source of uncertainty in the budget, with one or more rows.

    Attributes:
        name: name in prose.
        remedy: measure that lowers its share.
    """

    name: str
    remedy: str


LEG_MASSES = Group("masses and CoMs of the legs", "--leg-prior narrow, where the model file's legs were weighed")
LEG_LENGTHS = Group("lengths of the legs, hips, foot radii", "--leg-prior narrow, where they were measured")
JOINTS = Group("joint offsets, compliance and backlash", f"{MORE_TIME}; a jig for the joint offsets (--priors)")
IMU = Group("IMU: mounting, gains, biases, clock", MORE_TIME)
CABLE = Group("external force of a cable", "--cable none, where there is none; --rotate-halfway")
FLOOR = Group("feet and floor", "a hard, level floor; --rotate-halfway")
MOTORS = Group("torque constants, friction, rotors", USE_SCALE)
SCALE = Group("gain of the scale", "a better scale (--mass-std)")


@dataclass(frozen=True)
class Unknown:
    """Row of the parameter table.

    Attributes:
        meaning: noun phrase, with sign and frame.
        unit: SI unit; empty for a fraction.
        each: parts of the robot that have one parameter each, such as its joints.
        source: source of the prior.
        group: source of uncertainty in the budget.
        name: name in code, in settings and as a key.
        measure: quantity that the prior's number is a fraction of.
        label: name of one parameter in prose, with {each}.
        finding: name of one parameter in findings, reports and JSON, with {each}; empty: not reported.
        advice: message about one parameter, with {each}, {value}, {std} and {size}, the absolute value, in the displayed
            unit.
        advice_below: message if the value is zero or below; empty: `advice`.
        shown: number of displayed units in one SI unit.
        significant: least value that is worth fixing.
        drift: std of the change between two runs without disassembly, over the prior; None: nothing is kept.
        switched: std of the additional change when the robot is switched off in between, over the prior.
        checked: True if the check "sensor errors" tests the value.
        nonnegative: True if a value below zero is physically impossible.
        usual: default standard deviation of the prior, as a multiple of its measure.
        wide: standard deviation, as a multiple of its measure, if a run contradicts the usual prior; zero: none.
        cause: clause on the robot whose value is not the model's, in plain words.
        opened_by: flag that estimates the row where it is fixed; a file of priors always can.
    """

    meaning: str
    unit: str
    each: Each
    source: str
    group: Group
    name: str = ""
    measure: Measure = ITSELF
    label: str = ""
    finding: str = ""
    advice: str = ""
    advice_below: str = ""
    shown: float = 1.0
    significant: float = math.inf
    drift: float | None = 0.0
    switched: float = 0.0
    checked: bool = True
    nonnegative: bool = False
    usual: float = 0.0
    wide: float = 0.0
    cause: str = ""
    opened_by: str = ""

    def message(self, each: str, value: float, std: float) -> str:
        """Return the message about one parameter.

        Args:
            each: label of the parameter.
            value: value in the row's unit.
            std: posterior standard deviation of the value.
        """
        form = self.advice_below if self.advice_below and value <= 0 else self.advice
        value, std = value * self.shown, std * self.shown
        return form.format(each=each, value=value, std=std, size=abs(value))


def unknown(prior: float, meaning: str, unit: str, each: Each, source: str, group: Group, **more: Any) -> float:
    """Return a row of the table as a field of `Priors`; the arguments are those of `Unknown`.

    Args:
        prior: standard deviation, as a multiple of the row's measure.
    """
    return field(default=prior, metadata={ROW: Unknown(meaning, unit, each, source, group, usual=prior, **more)})


_REALISTIC = "assumed; as the simulation's `realistic` sensors"
_DEGREES = math.degrees(1.0)


@dataclass(frozen=True)
class Priors:
    """Standard deviations of the priors, as multiples of the rows' measures; all means are zero (or the model's value).

    The first three are of the base and the whole robot; all others are rows of the parameter table, in its order. Zero fixes
    such a row at the model's value.

    Attributes:
        mass: mass of the whole robot, as a fraction of the model's.
        first_moment: first moment of the base, over the model's base mass times the hip height.
        inertia: inertia of the base about its origin, over the model's largest moment.
    """

    mass: float = 0.3
    first_moment: float = 0.3
    inertia: float = 2.0
    leg_mass: float = unknown(
        0.05, "mass, first moment and inertia of a leg link over the model's, less one and the common part", "", LEG_LINK,
        "assumed; the simulation's `realistic` legs have 0.03",
        group=LEG_MASSES, label="mass of the link that {each} moves",
        cause="single leg links weigh more or less than in the file",
    )  # fmt: skip
    leg_mass_common: float = unknown(
        0.1, "common part of the leg links' masses over the model's, less one", "", ROBOT,
        "assumed: files of the same robot differ by that much",
        group=LEG_MASSES, label="mass of all leg links",
        cause="the legs weigh more or less than in the file", opened_by="--leg-prior wide",
    )  # fmt: skip
    link_com: float = unknown(
        0.011, "CoM of a leg link less the model's and the common part: down the link, forward, along the joint's axis",
        "m", LINK_AXIS, "assumed: CAD without cables; 3 mm on an A1",
        group=LEG_MASSES, measure=HIP_HEIGHT, label="CoM of the link of {each}",
        cause="CoMs of leg links differ from the file", opened_by="--leg-prior wide",
    )  # fmt: skip
    link_com_common: float = unknown(
        0.015, "common part of the CoMs of all links of one kind: down the link, forward", "m", KIND_AXIS,
        "assumed: CAD without cables; 4 mm on an A1",
        group=LEG_MASSES, measure=HIP_HEIGHT, label="CoM of all links of one kind, {each}",
        cause="CoMs of leg links differ from the file, in all legs alike", opened_by="--leg-prior wide",
    )  # fmt: skip
    joint_offset: float = unknown(
        5e-3, "encoder reading less joint position", "rad", JOINT, _REALISTIC,
        group=JOINTS, label="joint offset of {each}", finding="{each} offset", shown=_DEGREES, significant=4e-3, switched=0.1,
        advice="{each}: the joint offset is {value:+.2f} deg (std {std:.2f})",
        cause="joints have an offset between encoder reading and joint position",
    )  # fmt: skip
    compliance: float = unknown(
        5e-4, "deflection between encoder and link of one kind, over the joint's torque", "rad/Nm", JOINT_KIND,
        "assumed: springs of 2000 Nm/rad; no bench data of an A1 or Go2", group=JOINTS, measure=PER_A1_TORQUE,
        label="compliance of the {each} joints", finding="{each} compliance", shown=1000.0, significant=2e-4, checked=False,
        nonnegative=True,
        advice="the compliance of the {each} joints is {value:.2f} mrad/Nm (std {std:.2f})",
        advice_below="the compliance of the {each} joints is not measurable: {value:.2f} mrad/Nm (std {std:.2f})",
        cause="joints are compliant: springs in gears or shanks",
    )  # fmt: skip
    backlash: float = unknown(
        2e-3, "free angle in the gear of a joint of one kind", "rad", JOINT_KIND,
        "data sheets of gears: 0.05 to 0.25 deg", group=JOINTS, label="backlash of the {each} joints",
        finding="{each} backlash",
        shown=_DEGREES, significant=2e-3, checked=False, nonnegative=True,
        advice="the backlash of the {each} joints is {value:.2f} deg (std {std:.2f})",
        advice_below="the backlash of the {each} joints is not measurable: {value:.2f} deg (std {std:.2f})",
        cause="joints have backlash in their gears",
    )  # fmt: skip
    eccentricity: float = unknown(
        2e-3, "coefficients of the sine and the cosine of the encoder's reading in its error", "rad", JOINT_PHASE,
        "assumed: an off-centre magnet", group=JOINTS, label="eccentricity of {each}",
        cause="encoder errors vary over a turn of the joint: an off-centre magnet or a tilted axis",
    )  # fmt: skip
    imu_tilt: float = unknown(
        6e-3, "rotation vector of the IMU in its frame in the model", "rad", named("roll", "pitch", "yaw"),
        "assumed; the simulation's `realistic` sensors have 5 mrad",
        group=IMU, label="IMU tilt in {each}", finding="IMU {each}ed", shown=_DEGREES, significant=4e-3,
        advice="the IMU is {each}ed by {value:+.2f} deg (std {std:.2f})",
        cause="the IMU is mounted at an angle",
    )  # fmt: skip
    imu_position: float = unknown(
        2e-3, "position of the accelerometer less the model's, in base axes with x forward", "m", AXIS,
        "assumed: boards and drawings",
        group=IMU, wide=0.1,
        label="position of the IMU along {each}", finding="IMU position {each}", shown=1000.0, significant=4e-3,
        advice="the IMU is {value:+.1f} mm further along {each} than in the file (std {std:.1f})",
        cause="the position of the IMU differs from the file",
    )  # fmt: skip
    accelerometer_bias: float = unknown(
        0.03, "accelerometer reading less specific force, in the IMU frame", "m/s2", AXIS, _REALISTIC,
        group=IMU, label="accelerometer bias {each}", finding="accelerometer bias {each}", significant=0.05, drift=0.2,
        advice="the accelerometer's {each} reads {value:+.3f} m/s2 too much (std {std:.3f})",
        cause="the accelerometer has a bias",
    )  # fmt: skip
    accelerometer_gain: float = unknown(
        5e-3, "accelerometer reading without bias over specific force along each axis, less one", "", AXIS,
        "data sheets of MEMS accelerometers: 0.3 to 1 %",
        group=IMU, label="accelerometer gain {each}", finding="accelerometer gain {each}", significant=0.01, drift=0.1,
        advice="the accelerometer's {each} axis reads {value:+.2%} too much (std {std:.2%})",
        cause="the accelerometer's axes have gain errors",
    )  # fmt: skip
    accelerometer_drift: float = unknown(
        0.03, "change of the accelerometer's bias from the start of the run to its end", "m/s2", AXIS, "an IMU that warms up",
        group=IMU, label="drift of the accelerometer's {each}", drift=None,
        cause="the accelerometer's bias drifts: wait until the IMU is warm",
    )  # fmt: skip
    gyro_drift: float = unknown(
        2e-3, "change of the gyroscope's bias from the start of the run to its end", "rad/s", AXIS, "an IMU that warms up",
        group=IMU, label="drift of the gyroscope's {each}", drift=None,
        cause="the gyroscope's bias drifts: wait until the IMU is warm",
    )  # fmt: skip
    gyro_gain: float = unknown(
        0.01, "measured less true angular velocity along each axis, over the measured one", "", AXIS,
        "data sheets of MEMS gyroscopes: 1 to 3 % uncalibrated, 0.3 to 1 % calibrated",
        group=IMU, label="gyroscope gain {each}", finding="gyroscope gain {each}", significant=0.02, drift=0.1,
        advice="the gyroscope's {each} axis reads {value:+.2%} too much (std {std:.2%})",
        cause="the gyroscope's axes have gain errors",
    )  # fmt: skip
    gyro_misalignment: float = unknown(
        6e-3, "reading of an axis per angular velocity about another axis", "rad",
        named("x of y", "x of z", "y of x", "y of z", "z of x", "z of y"),
        "assumed; data sheets: 2 mrad between the axes, 5 mrad against the accelerometer",
        group=IMU, label="gyroscope misalignment, {each}", drift=0.1,
        cause="the gyroscope's axes are not aligned with the accelerometer's",
    )  # fmt: skip
    clock_offset: float = unknown(
        2e-3, "time by which an IMU sample is younger than a joint sample of the same stamp", "s", ROBOT,
        "assumed; a sample of a 500 Hz bus is up to 2 ms old, and an IMU's filter as late",
        group=IMU, label="clock offset", finding="clock offset", shown=1000.0, significant=1e-3, drift=None,
        advice="IMU samples are {size:.2f} ms younger than joint samples of the same stamp",
        advice_below="IMU samples are {size:.2f} ms older than joint samples of the same stamp",
        cause="IMU and joint samples of one stamp are not of one time: a filter or a bus delays one",
    )  # fmt: skip
    gyro_lag: float = unknown(
        2e-3, "age of a gyroscope sample less that of the accelerometer sample of the same stamp", "s", ROBOT,
        "data sheets: filters of 5 to 50 Hz of the two differ by 1 to 4 ms",
        group=IMU, label="lag of the gyroscope", finding="lag of the gyroscope", shown=1000.0, significant=1e-3, drift=None,
        advice="gyroscope samples are {size:.2f} ms older than accelerometer samples of the same stamp",
        advice_below="gyroscope samples are {size:.2f} ms younger than accelerometer samples of the same stamp",
        cause="gyroscope and accelerometer samples of one stamp are not of one time: their filters differ",
    )  # fmt: skip
    foot_radius: float = unknown(
        0.02, "radius of all feet over the model's, less one", "", ROBOT, "assumed; rubber wears and deforms",
        group=LEG_LENGTHS, label="foot radius", finding="foot radius", significant=0.03,
        advice="the rolling radius of the feet differs by {value:+.1%} from the model",
        cause="the feet are larger or smaller than in the file, or soft",
    )  # fmt: skip
    foot_width: float = unknown(
        0.01, "half-width of the feet beyond that of spheres, across and along the legs", "m", named("across", "along"),
        "assumed: 3 mm on an A1, or what the file's feet have; worn feet a few millimetres", group=LEG_LENGTHS, measure=FEET,
        label="half-width of the feet {each} the legs", finding="half-width of the feet {each}", shown=1000.0,
        significant=2e-3,
        drift=0.1, checked=False, nonnegative=True,
        advice="the feet are not spheres: their half-width {each} the legs is {value:+.1f} mm (std {std:.1f})",
        advice_below="the feet's half-width {each} the legs is not measurable: {value:.1f} mm (std {std:.1f})",
        cause="the feet are wide, as cylinders, or worn flat",
    )  # fmt: skip
    rolling_resistance: float = unknown(
        2e-2, "moment of the feet's rolling resistance, over the load on them", "m", ROBOT,
        "wide: rubber has 0.3 to 1 mm; contact models of vendors up to 10 mm", group=FLOOR, measure=HIP_HEIGHT,
        label="rolling resistance of the feet", finding="rolling resistance", shown=1000.0, significant=1e-3, drift=0.5,
        checked=False, nonnegative=True,
        advice="the rolling resistance of the feet is {value:+.2f} mm (std {std:.2f})",
        advice_below="the rolling resistance of the feet is not measurable: {value:.2f} mm (std {std:.2f})",
        cause="the feet have rolling resistance: soft rubber or a soft floor",
    )  # fmt: skip
    foot_radius_each: float = unknown(
        0.05, "radius of each foot over the model's, less one and the common part", "", LEG,
        "assumed: 1 mm on an A1; worn feet",
        group=LEG_LENGTHS, label="foot radius of {each}",
        cause="some feet are larger or smaller than in the file: worn, or soft", opened_by="--leg-prior wide",
    )  # fmt: skip
    foot_compliance: float = unknown(
        5e-5, "sag of a foot and the floor under it, over the load on the foot", "m/N", ROBOT,
        "assumed: rubber of 20 kN/m; no bench data of an A1 or Go2", group=FLOOR, measure=PER_A1_STIFFNESS,
        label="foot compliance", finding="foot compliance", shown=1e5, significant=2e-5, drift=0.5, checked=False,
        nonnegative=True,
        advice="the compliance of feet and floor is {value:.1f} mm per 100 N (std {std:.1f})",
        advice_below="the compliance of feet and floor is not measurable: {value:.1f} mm per 100 N (std {std:.1f})",
        cause="the feet or the floor are compliant: soft rubber or a soft floor",
    )  # fmt: skip
    link_length: float = unknown(
        0.0026, "length of a thigh or calf less the model's and the common part", "m", LENGTH,
        "0.7 mm on an A1: tolerances",
        group=LEG_LENGTHS, wide=0.02, measure=HIP_HEIGHT, label="length of {each}",
        cause="thighs or calves are longer or shorter than in the file", opened_by="--leg-prior wide",
    )  # fmt: skip
    link_length_common: float = unknown(
        0.0037, "common part of all thigh lengths, and of all calf lengths", "m", LENGTH_KIND,
        "assumed: 1 mm on an A1; worn feet",
        group=LEG_LENGTHS, wide=0.1, measure=HIP_HEIGHT, label="length of all {each}",
        finding="length of the {each}", shown=1000.0,
        significant=2e-3,
        advice="the {each} are {value:+.1f} mm longer than in the model (std {std:.1f})",
        cause="thighs or calves are longer or shorter than in the file, in all legs alike", opened_by="--leg-prior wide",
    )  # fmt: skip
    hip_position: float = unknown(
        0.0026, "position of a leg's first joint less the model's, in the base frame", "m", HIP_AXIS,
        "0.7 mm on an A1: tolerances",
        group=LEG_LENGTHS, wide=0.1, measure=HIP_HEIGHT, label="hip position {each}",
        cause="hip positions differ from the file", opened_by="--leg-prior wide",
    )  # fmt: skip
    external_force: float = unknown(
        0.2, "constant horizontal force on the base, forward and to its left at the run's start: a cable", "N",
        named("forward", "left"),
        "half a metre of Ethernet cable, on robots of any size",
        group=CABLE, label="external force {each}", drift=None,
        cause="a horizontal force acts on the base: a cable or a hand?", opened_by="--cable light",
    )  # fmt: skip
    hanging_load: float = unknown(
        0.08, "moment of a hanging load about the base's origin, about its forward and left axes", "Nm",
        named("forward", "left"),
        "half a metre of Ethernet cable, 0.2 N, at the end of a trunk",
        group=CABLE, measure=HIP_HEIGHT, label="moment of a hanging cable about {each}", drift=None,
        cause="a load hangs from the base: a cable or a hose", opened_by="--cable light",
    )  # fmt: skip
    tether_stiffness: float = unknown(
        10.0, "stiffness of a tether between the end of the trunk and its position at the nominal stance", "N/m", ROBOT,
        "a hose has 10 to 20",
        group=CABLE, label="stiffness of a tether", finding="stiffness of a tether", significant=5.0, drift=None,
        checked=False, nonnegative=True,
        advice="a hose or a tether holds the trunk back with {value:.1f} N/m (std {std:.1f})",
        advice_below="the stiffness of a tether is not measurable: {value:.1f} N/m (std {std:.1f})",
        cause="a hose or a tether holds the trunk back", opened_by="--cable light",
    )  # fmt: skip
    floor_slope: float = unknown(
        5e-3, "floor normal less up, in base axes at the nominal stance and the run's start", "rad", named("x", "y"),
        _REALISTIC,
        group=FLOOR, label="floor slope along {each}", finding="floor slope {each}", shown=_DEGREES, significant=8e-3,
        drift=None,
        advice="the floor slopes along {each} by {value:+.2f} deg (std {std:.2f})",
        cause="the floor slopes",
    )  # fmt: skip
    floor_warp: float = unknown(
        1e-3, "height of two diagonal footholds above the mean of all four", "m", ROBOT, "assumed; an indoor floor",
        group=FLOOR, measure=HIP_HEIGHT, label="floor warp", drift=None, checked=False,
        cause="the four footholds are not in one plane",
    )  # fmt: skip
    foothold_change: float = unknown(
        0.0037, "height of a foothold after the robot was rotated, less that from slope and warp", "m", LEG,
        "assumed: 1 mm on an A1, an indoor floor; fixed without --rotate-halfway", group=FLOOR, measure=HIP_HEIGHT,
        label="height of the new foothold of {each}", drift=None, checked=False,
        cause="the footholds after the rotation are not in one plane with those before",
    )  # fmt: skip
    torque_gain_common: float = unknown(
        0.2, "true over reported torque of all joints, less one", "", ROBOT,
        "one motor type, one torque constant; a vendor's bench: the true torque is 1/1.3 to 1/1.5 of the reported one",
        group=MOTORS, label="torque gain of all joints", finding="torque gain", significant=0.05, drift=0.1,
        advice="true joint torques differ by {value:+.1%} from the reported ones (std {std:.1%})",
        cause="reported and true joint torques differ",
    )  # fmt: skip
    torque_gain: float = unknown(
        0.03, "true over reported torque of each joint, less one and the common part", "", JOINT, _REALISTIC,
        group=MOTORS, label="torque gain of {each}", finding="{each} torque gain", significant=0.05, drift=0.1,
        advice="{each}: the true torque differs by {value:+.1%} from the reported one (std {std:.1%})",
        cause="reported and true torques of single joints differ",
    )  # fmt: skip
    coulomb_friction: float = unknown(
        0.5, "Coulomb friction of every joint", "Nm", ROBOT, "wide: the simulation's `realistic` joints have 0.3",
        group=MOTORS, measure=A1_TORQUE, label="Coulomb friction", finding="Coulomb friction of the joints", drift=0.2,
        checked=False,
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
        checked=False,
        nonnegative=True,
        advice="viscous friction of the joints: {value:.3f} Nm s/rad",
        cause="the joints have friction that grows with speed",
    )  # fmt: skip
    armature: float = unknown(
        0.02, "rotor inertia at every joint", "kg m2", ROBOT, "wide: the simulation's `realistic` joints have 0.01",
        group=MOTORS, measure=A1_TORQUE, label="armature", finding="armature of the joints", checked=False, nonnegative=True,
        advice="armature of the joints: {value:.3f} kg m2",
        cause="the rotors have inertia",
    )  # fmt: skip

    def __post_init__(self) -> None:
        rows = {row.name for row in self.rows()}
        for prior in fields(self):
            value = getattr(self, prior.name)
            if not (0 < value < math.inf or (value == 0 and prior.name in rows)):
                fixed = ", or zero to fix the parameter" if prior.name in rows else ""
                raise SettingsError(
                    f"the prior of {prior.name} is {value}; it must be a finite number above zero{fixed}"
                )

    def holding(self, *names: str) -> Priors:
        """Return these priors with some rows fixed at the model's values."""
        return replace(self, **dict.fromkeys(names, 0.0))

    @property
    def all_open(self) -> Priors:
        """These priors with the usual prior for each fixed row."""
        fixed = (row for row in self.rows() if getattr(self, row.name) == 0)
        return replace(self, **{row.name: row.usual for row in fixed})

    @classmethod
    def read(cls, path: Path) -> Priors:
        """Read a TOML file of numbers by name; other priors keep their defaults.

        Raises:
            SettingsError: the file does not exist or is not TOML, or a name or number in it is invalid.
        """
        try:
            table = toml_table(read_text(path))
        except (OSError, ValueError) as error:
            raise SettingsError(f"cannot read priors from {path}: {error}") from error
        names = {field.name: field for field in fields(cls)}
        for name, value in table.items():
            if name not in names:
                raise SettingsError(
                    f"{path}: {name!r} is not a parameter; {did_you_mean(name, names)}choose from {', '.join(names)}"
                )
            if not isinstance(value, int | float) or isinstance(value, bool):
                raise SettingsError(f"{path}: the prior of {name} is {value!r}; it must be a number")
        return cls(**{name: float(value) for name, value in table.items()})

    @property
    def estimated(self) -> tuple[Unknown, ...]:
        """Rows that are not fixed."""
        return tuple(row for row in self.rows() if getattr(self, row.name) > 0)

    @property
    def widened(self) -> tuple[Unknown, ...]:
        """Rows with a wide prior, whose values in the model file the run contradicts."""
        return tuple(row for row in self.rows() if row.wide and getattr(self, row.name) == row.wide)

    @classmethod
    def rows(cls) -> tuple[Unknown, ...]:
        """Return the parameter table."""
        return tuple(replace(row.metadata[ROW], name=row.name) for row in fields(cls) if ROW in row.metadata)

    @classmethod
    def row(cls, name: str) -> Unknown:
        """Return the row of a name."""
        return next(row for row in cls.rows() if row.name == name)


def model_values(robot: RobotModel) -> dict[str, FloatArray]:
    """Return the `Values` of a robot without model or sensor errors on a level floor: all zero."""
    return {row.name: np.zeros(len(row.each.labels(robot))) for row in Priors.rows()}


def inputs_of(values: Values, names: Sequence[str], count: int, by: Sequence[str] = ()) -> TracedValues:
    """Return the named values as inputs of an equation of `count` samples.

    Args:
        values: (size,) values common to all samples, or (size, count) values of each.
        by: names of the values for derivatives.
    """

    def repeated(name: str) -> Traced:
        given = values[name]
        value = np.broadcast_to(given if given.ndim == 2 else given[:, None], (len(given), count))
        return Traced.input(value) if name in by else Traced(value)

    return {name: repeated(name) for name in names}


def finding_names(robot: RobotModel, name: str) -> list[str]:
    """Return the names of the findings of a row."""
    row = Priors.row(name)
    return [row.finding.format(each=label) for label in row.each.labels(robot)]
