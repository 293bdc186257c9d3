"""Row of the parameter table: count, unit, prior and its source, messages. The table is in unknowns.py."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from equipoise.robot.model import RobotModel
    from equipoise.robot.stance import Stance


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
