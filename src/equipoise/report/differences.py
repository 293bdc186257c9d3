"""First lines of a report: numbers that differ from the model file, their effect on a controller, and the next command.

A convex MPC plans foot forces F that balance about the CoM c of its model. About a CoM c + d they leave the moment -d x F to
feedback: with F = m g, nose down for a CoM further forward, and to the left for one further left.
"""

from __future__ import annotations

from equipoise.calibration.payload_change import negligible_changes
from equipoise.conventions import GRAVITY
from equipoise.figures.blocks import Block
from equipoise.figures.parts import motors_alone
from equipoise.result.calibration import Calibration
from equipoise.result.legend import doubt_message
from equipoise.result.quantity import Quantity
from equipoise.result.shown import called
from equipoise.robot.stance import stance_at

_MOST = 3
_WORDS = {
    "x": ("further forward", "further back"),
    "y": ("further left", "further right"),
    "z": ("higher", "lower"),
}
_TIPS = {"x": ("nose down", "nose up"), "y": ("to the left", "to the right")}
_MOTIONS = {"x": "roll", "y": "pitch", "z": "yaw"}


def action_blocks(result: Calibration, run: str) -> list[Block]:
    """Return the numbers that differ from the model file with their effect, and the command that writes them.

    Args:
        run: path of the run for the command.
    """
    if doubt := doubt_message(result):
        return [f"{doubt} Do not use these numbers before the failed checks below are resolved."]
    if motors_alone(result):
        return ["To estimate mass, centre of mass and inertia in the same run, pass `--parameters base,motors`."]
    if not result.has_intervals:
        return [
            f"`{result.method}` gives no intervals, so no difference from the model file is known to be significant. "
            "`calibrate --method bayesian` gives them."
        ]
    found = significant_differences(result)
    if not found:
        return [
            "The model file needs no change: no number of the whole robot differs from it significantly and by more than 1 % "
            "of the mass, 2 mm (on an A1) or 5 % of the largest moment of inertia. A wide interval may hide a difference."
        ]
    others = f"; also {', '.join(called(one.name) for one in found[_MOST:])}" if found[_MOST:] else ""
    return [
        f"Update the model file of your controller. The whole robot differs from it significantly{others}:",
        tuple(_effect(one, result) for one in found[:_MOST]),
        _command(result, run),
    ]


def significant_differences(result: Calibration) -> list[Quantity]:
    """Return the quantities of the composite whose change is outside the interval and not negligible, the largest first."""
    robot, model = result.robot_model, result.nominal.composite
    length = 1.0
    if robot is not None:
        stance = stance_at(robot, robot.joint_vector(dict(result.joint_position), "the run's stance"))
        length = stance.scale.length
    sizes = negligible_changes(model, length)
    ratios = {
        one: abs(one.change) / size
        for one, size in zip(result.composite, sizes, strict=True)
        if one.change is not None and one.half_width is not None and abs(one.change) > max(one.half_width, size)
    }
    return sorted(ratios, key=lambda one: -ratios[one])


def _effect(one: Quantity, result: Calibration) -> str:
    """Return a difference and its effect on a controller."""
    mass, change, half = (value or 0.0 for value in (result.composite.mass.value, one.change, one.half_width))
    if one.name == "mass":
        word, force, place = ("more", "little", "lower") if change > 0 else ("less", "much", "higher")
        return (
            f"The robot has {abs(change):.2f} +- {half:.2f} kg {word} mass than in the file: a convex MPC commands "
            f"{GRAVITY * abs(change):.1f} N too {force} vertical force, so the base stands {place}."
        )
    if one.name.startswith("com_"):
        axis = one.name[-1]
        shift = (
            f"The CoM is {1000 * abs(change):.1f} +- {1000 * half:.1f} mm {_WORDS[axis][change < 0]} than in the file"
        )
        if axis == "z":
            moment = mass * abs(change)
            return f"{shift}: in a convex MPC, each m/s2 of horizontal acceleration leaves {moment:.2f} Nm to feedback."
        moment, tips = mass * GRAVITY * abs(change), _TIPS[axis][change < 0]
        return f"{shift}: in a convex MPC, the planned foot forces leave {moment:.2f} Nm, {tips}, to feedback."
    first, second = one.name[1:]
    size = (
        f"{one.name} is {abs(change):.4f} +- {half:.4f} kg m2 {'larger' if change > 0 else 'smaller'} than in the file"
    )
    if first == second:
        ratio = (one.model or 0.0) / (one.value or 1.0) - 1
        effect = f"accelerates the robot {100 * abs(ratio):.0f} % {'more' if ratio > 0 else 'less'} than planned"
        return f"{size}: an MPC's moment in {_MOTIONS[first]} {effect}."
    moment = f"{10 * abs(change):.2f} Nm in {_MOTIONS[second]}"
    return f"{size}: in an MPC, each 10 rad/s2 in {_MOTIONS[first]} leaves {moment} to feedback."


def _command(result: Calibration, run: str) -> str:
    missing = [called(one.name) for one in result.base if one.verdict in (None, "not identified")]
    if missing:
        return f"Not identified for the base link: {', '.join(missing)}. Increase `--duration` or pass `--mass`; then export."
    return (
        f"Write the numbers: `equipoise export {run} --to {result.model['format']}` for whole-body control and simulation; "
        "for an MPC, `--to quadruped-pympc`, `unitree-guide`, `mit-cheetah` or `quad-sdk`."
    )
