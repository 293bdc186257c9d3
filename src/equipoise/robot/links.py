"""Links of a Pinocchio model: names and inertias of the file, and checks of its units."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from equipoise.conventions import FloatArray
from equipoise.errors import ModelError
from equipoise.robot.scale import HEAVIEST
from equipoise.robot.source import ModelSource

# A link's own inertia is the joint's minus that of fixed links; a remainder below this fraction of the robot is rounding.
_ROUNDING = 1e-6
_EQUAL = 1e-6  # files print 4 to 9 digits

_LONGEST_LEG = 5.0  # [m]; files in other units are a hundred to a thousand times the robot
_CENTIMETRES = 50.0  # [m] of leg below which the unit is ambiguous: in millimetres it would be a toy's
_MATTERS = 0.01  # of the robot's mass; lighter links may have any placeholder for an inertia
_FARTHEST_COM = 2.0  # robot sizes from a link's joint to its centre of mass; those of the catalogue have at most 0.3
_MILLIMETRES = 20.0  # robot sizes beyond which the farthest CoM is in millimetres; in centimetres they are 4 to 15
_LARGEST_RADIUS = 5.0  # radii of gyration over a link's length; in the smallest wrong unit, kg cm2, they are 10 to 50
_ABSURD_RADIUS = 40.0  # the same of light links, whose placeholders come to 25
_USUAL_RADIUS = 0.27  # of a link's length: median of the catalogue
_INERTIA_UNITS = {"kg cm2": 4, "kg mm2": 6, "g cm2": 7, "g mm2": 9}  # powers of ten in a kg m2


@dataclass(frozen=True, eq=False)
class FileLink:
    """Link of the file that has mass.

    Attributes:
        name: name of the link.
        joint: Pinocchio's id of the joint that moves it.
        placement: placement of its frame in the joint's.
        inertia: inertia in its own frame.
    """

    name: str
    joint: int
    placement: pin.SE3
    inertia: pin.Inertia


def file_links(model: pin.Model) -> Iterator[FileLink]:
    """Yield every link that has mass. Pinocchio keeps the inertias of fixed links on their joints' frames."""
    least = _ROUNDING * pin.computeTotalMass(model)
    fixed_names = {frame.parentFrame: str(frame.name) for frame in model.frames if frame.type == pin.FrameType.BODY}
    own_names = link_names(model)
    for joint in range(1, model.njoints):
        own = pin.Inertia(model.inertias[joint])
        for index, frame in enumerate(model.frames):
            if frame.parentJoint == joint and frame.type == pin.FrameType.FIXED_JOINT and frame.inertia.mass > 0:
                own -= frame.placement.act(frame.inertia)
                yield FileLink(fixed_names.get(index, str(frame.name)), joint, frame.placement, frame.inertia)
        if own.mass > least:
            yield FileLink(own_names.get(joint, str(model.names[joint])), joint, pin.SE3.Identity(), own)


def link_names(model: pin.Model) -> dict[int, str]:
    """Return the name of the link that each joint moves, without those fixed to it."""
    return {
        int(frame.parentJoint): str(frame.name)
        for frame in model.frames
        if frame.type == pin.FrameType.BODY and model.frames[frame.parentFrame].type == pin.FrameType.JOINT
    }


def radius_of_gyration_of(mass: float, moments: FloatArray) -> float:
    """Return sqrt(tr(I) / 2m) [m], from principal moments; 0 without mass."""
    return math.sqrt(max(float(moments.sum()), 0.0) / (2 * mass)) if mass > 0 else 0.0


def equal_round_moment(inertia: FloatArray) -> float | None:
    """Return v of an inertia v * identity if v has one digit, as 1, 0.1 or 5e-4 [kg m2]; else None."""
    moment = float(np.trace(inertia)) / 3
    if moment <= 0 or np.abs(inertia - moment * np.eye(3)).max() > _EQUAL * moment:
        return None
    digits = moment / 10 ** math.floor(math.log10(moment * (1 + _EQUAL)))
    return moment if abs(digits - round(digits)) < 10 * _EQUAL else None


def refuse_other_units(model: pin.Model, leg_length: float, hips: FloatArray, source: ModelSource) -> None:
    """Refuse a file that is not in metres, kilograms and kg m2; CAD models are often in millimetres and grams.

    Args:
        model: Pinocchio model with all joints of the file.
        leg_length: length of thigh and shank together [m].
        hips: (4, 3) hips in the base frame [m].
        source: cleaned file; links whose inertia was repaired are left to the audit.
    """
    path = source.path
    mass = float(pin.computeTotalMass(model))
    if leg_length > _LONGEST_LEG:
        like = "look like millimetres" if leg_length > _CENTIMETRES else "are in another unit"
        raise ModelError(
            f"robot model {str(path)!r} has legs of {leg_length:.3g} m: its lengths {like}; give them in metres, inertias in "
            "kg m2"
        )
    if mass > HEAVIEST:
        raise ModelError(
            f"robot model {str(path)!r} weighs {mass:.0f} kg: its masses look like grams; give them in kg, inertias in kg m2"
        )
    links = list(file_links(model))
    repaired = {link.name for link in links if any(text.startswith(f"link {link.name!r} ") for text in source.repairs)}
    limits = {
        link.name: _LARGEST_RADIUS if link.inertia.mass > _MATTERS * mass else _ABSURD_RADIUS
        for link in links
        if link.name not in repaired
    }
    trunk = 2 * float(np.linalg.norm(hips - hips.mean(axis=0), axis=1).mean())
    _refuse_far_coms(links, trunk + leg_length, hips.mean(axis=0), path)
    _refuse_large_inertias(links, limits, trunk, leg_length / 2, path)


def _refuse_far_coms(links: list[FileLink], size: float, middle: FloatArray, path: Path) -> None:
    """Refuse far CoMs on a robot of this `size` [m]; `middle` (3,) is the hips' mean in the base frame [m]."""
    coms = {link.name: link.placement.act(link.inertia.lever) - (middle if link.joint == 1 else 0.0) for link in links}
    far = {name: away for name, com in coms.items() if (away := float(np.linalg.norm(com))) > _FARTHEST_COM * size}
    if not far:
        return
    worst = max(far, key=lambda name: far[name])
    most = 2 * len(far) > len(links)
    unit, factor = "millimetres", "1000"
    if far[worst] < _MILLIMETRES * size:  # of one link alone that may be its millimetres, too
        unit, factor = ("centimetres", "100") if most else ("centimetres or millimetres", "100 or 1000")
    raise ModelError(
        f"robot model {str(path)!r}: the centre of mass of link {worst!r} is {far[worst]:.4g} m away, on a robot of "
        f"{size:.2g} m: it looks like {unit}; divide by {factor} the centres of mass of {', '.join(far)}"
        + (", and of all other links" if most else "")
    )


def _refuse_large_inertias(
    links: list[FileLink], limits: dict[str, float], trunk: float, limb: float, path: Path
) -> None:
    """Refuse radii of gyration beyond a link's limit, over the lengths `trunk` (base) and `limb` (leg link) [m]."""
    ratios: dict[str, float] = {}
    for link in links:
        inertia, length = np.array(link.inertia.inertia), trunk if link.joint == 1 else limb
        moments = np.asarray(np.linalg.eigvalsh(inertia), dtype=float)
        physical, made_up = moments[2] <= 1.001 * (moments[0] + moments[1]), equal_round_moment(inertia) is not None
        radius = radius_of_gyration_of(link.inertia.mass, moments)
        if physical and not made_up and radius > limits.get(link.name, math.inf) * length:
            ratios[link.name] = radius / length
    if not ratios:
        return
    worst, named = max(ratios, key=lambda name: ratios[name]), ", ".join(ratios)
    found = (
        f"robot model {str(path)!r}: the inertia of link {worst!r} has a radius of gyration of {ratios[worst]:.3g} times the "
        "link's length"
    )
    if all(limits[name] > _LARGEST_RADIUS for name in ratios):  # the size of feet and similar links is unknown
        raise ModelError(
            f"{found}: give the inertias of {named} in kg m2 (1 kg cm2 is 1e-4, 1 g cm2 is 1e-7, 1 g mm2 is 1e-9 kg m2)"
        )
    # A radius of gyration goes with the root of the inertia: half the power of ten is missing.
    power = 2 * math.log10(float(np.median(list(ratios.values()))) / _USUAL_RADIUS)
    unit = min(_INERTIA_UNITS, key=lambda unit: abs(power - _INERTIA_UNITS[unit]))
    if abs(power - _INERTIA_UNITS[unit]) > 1:
        return  # not a known unit: the audit names it
    raise ModelError(
        f"{found}: it looks like {unit}; divide by 1e{_INERTIA_UNITS[unit]} the inertias of {named}, which gives kg m2"
        + (", and of all other links" if 2 * len(ratios) > len(links) else "")
    )
