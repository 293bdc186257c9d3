"""A row of the table of unknowns: how many there are of it, its unit, the source of its prior, and what is said of it.

The table itself is in unknowns.py.
"""

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
    """What there is one of an unknown of.

    Attributes:
        name: name of it in words.
        labels: names of all of them, for a robot.
    """

    name: str
    labels: Callable[[RobotModel], tuple[str, ...]]


@dataclass(frozen=True)
class Measure:
    """What the number that a prior is given as is a fraction of.

    Attributes:
        name: name of it in words.
        of: function that gives its size in the unknown's unit.
    """

    name: str
    of: Callable[[RobotModel, Stance], float]


def named(*labels: str) -> Each:
    """As many as there are names, on any robot."""
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


MORE_TIME, A_SCALE = "more robot time (--duration)", "a scale (--mass)"


@dataclass(frozen=True)
class Group:
    """Rows that people think of as one source of uncertainty.

    Attributes:
        name: name of it in words.
        remedy: what lowers its share.
    """

    name: str
    remedy: str


LEG_MASSES = Group("masses and CoMs of the legs", "--leg-prior narrow, where the model file's legs were weighed")
LEG_LENGTHS = Group("lengths of the legs, hips, foot radii", "--leg-prior narrow, where they were measured")
JOINTS = Group("joint offsets, springs and play", f"{MORE_TIME}; a jig for the zeros (--priors)")
IMU = Group("IMU: mounting, gains, biases, clock", MORE_TIME)
CABLE = Group("a cable's pull", "--cable none, where there is none; --rotate-halfway")
FLOOR = Group("feet and floor", "a hard, level floor; --rotate-halfway")
MOTORS = Group("torque constants, friction, rotors", A_SCALE)
SCALE = Group("gain of the scale", "a better scale (--mass-std)")


@dataclass(frozen=True)
class Unknown:
    """A row of the table.

    Attributes:
        meaning: noun phrase, with sign and frame.
        unit: SI unit; empty for a fraction.
        each: parts of the robot that have one each, as its joints.
        source: source of the prior.
        group: source of uncertainty that it is counted with.
        name: name in code, in settings and as a key.
        measure: quantity that the prior's number is a fraction of.
        label: name of one of them in prose, with {each}.
        finding: name of one of them among the findings, in reports and JSON, with {each}; empty: not reported.
        advice: sentence about one of them, with {each}, {value}, {std} and {size}, the value without its sign, in the
            unit shown.
        advice_below: the same where the value is not above zero; empty: no difference.
        shown: number of the unit shown that are one in the unit.
        significant: least value that is worth fixing.
        drift: change of it between two runs of a robot that nobody took apart, over its prior; None: nothing is kept.
        switched: change of it beside that where the robot was switched off in between, over its prior.
        judged: whether a value far from zero speaks against a result.
        nonnegative: whether a value below zero is physically impossible.
        usual: standard deviation of the prior where nobody said another, as a multiple of its measure.
        otherwise: the same of a robot of which the model's number is not at all, taken where a run contradicts the usual
            prior; zero: there is none.
        cause: sentence on a robot that the model's value does not fit, in words of a workshop.
        opened_by: flag that makes the row unknown where it is held; a file of priors can always.
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
    judged: bool = True
    nonnegative: bool = False
    usual: float = 0.0
    otherwise: float = 0.0
    cause: str = ""
    opened_by: str = ""

    def message(self, each: str, value: float, std: float) -> str:
        """What is to be said of one of them.

        Args:
            each: label of the unknown.
            value: value in the row's unit.
            std: posterior standard deviation of the value.
        """
        form = self.advice_below if self.advice_below and value <= 0 else self.advice
        value, std = value * self.shown, std * self.shown
        return form.format(each=each, value=value, std=std, size=abs(value))


def unknown(prior: float, meaning: str, unit: str, each: Each, source: str, group: Group, **more: Any) -> float:
    """A row of the table as a field of `Priors`; the arguments are those of `Unknown`.

    Args:
        prior: standard deviation, as a multiple of the row's measure.
    """
    return field(default=prior, metadata={ROW: Unknown(meaning, unit, each, source, group, usual=prior, **more)})
