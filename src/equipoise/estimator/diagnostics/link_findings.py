"""What was found about the moving links of the legs: masses, first moments, lengths."""

from __future__ import annotations

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.parameters import LINKS, Unknowns
from equipoise.result.findings import Link
from equipoise.result.quantity import Quantity
from equipoise.result.statistics import verdict_of
from equipoise.robot.links import link_names

_NAMES = ("mass", "moment_x", "moment_y", "moment_z", "length")
_UNITS = ("kg", "kg m", "kg m", "kg m", "m")


def link_findings(unknowns: Unknowns, x: FloatArray, covariance: FloatArray) -> dict[str, Link]:
    """Every moving link of the legs, by its name; each number beside what was believed of it before the run.

    A link's own inertia is taken to go with its mass: no motion of a standing robot shows it by itself.

    Args:
        x: (size,) unknowns.
        covariance: (size, size) their covariance after the run.
    """
    robot, legs = unknowns.robot, unknowns.legs
    model, derivative = _at_the_model(unknowns, legs)
    values = model + derivative @ (x * unknowns.scale)
    combined_priors = np.eye(unknowns.size)
    if unknowns.belief is not None:
        combined_priors[unknowns.tabled, unknowns.tabled] = unknowns.belief.covariance
    rows = derivative * unknowns.scale
    before, after = (np.einsum("ij,jk,ik->i", rows, spread, rows) for spread in (combined_priors, covariance))
    # What the CoMs of one kind of link have in common along their joints' axes is no unknown: as much of it is left as of a
    # link's own.
    along = _along_axes(unknowns, legs)
    left = np.divide(after, before, out=np.ones_like(after), where=before > 0)
    before, after = np.sqrt(before + along), np.sqrt(after + left * along)
    names = link_names(robot.full_pinocchio)
    joints = [name for leg in robot.legs.values() for name in leg.joint_names]
    told = zip(values.reshape(-1, 5), after.reshape(-1, 5), before.reshape(-1, 5), model.reshape(-1, 5), strict=True)
    return {
        names[robot.full_pinocchio.getJointId(joint)]: Link(**_quantities(*numbers))
        for joint, numbers in zip(joints, told, strict=True)
    }


def _along_axes(unknowns: Unknowns, legs: LegChains) -> FloatArray:
    """(5 links,) variance of the moments by CoMs that all links of a kind have off along their joints' axes."""
    variance = np.zeros((legs.links, 5))
    if unknowns.estimates("link_com_common"):
        std = legs.mass.reshape(-1, 1) * unknowns.scale[unknowns["link_com_common"]][0]
        variance[:, 1:4] = (std * legs.axes.reshape(-1, 3, 3)[:, :, 2]) ** 2
    return variance.ravel()


def _quantities(values: FloatArray, after: FloatArray, before: FloatArray, model: FloatArray) -> dict[str, Quantity]:
    """Of one link, those that were open."""
    return {
        name: Quantity(name, unit, float(value), float(sd), verdict_of(float(sd), float(prior)), float(by_model))
        for name, unit, value, sd, prior, by_model in zip(_NAMES, _UNITS, values, after, before, model, strict=True)
        if prior > 0
    }


def _at_the_model(unknowns: Unknowns, legs: LegChains) -> tuple[FloatArray, FloatArray]:
    """(5 links,) numbers of the links by the model, as in _NAMES; (5 links, size) their derivative by the unknowns."""
    chains = [(leg, place) for leg in range(4) for place in range(legs.joints.shape[1])]
    derivative = np.zeros((5 * legs.links, unknowns.size))
    moments = _by_parameters(unknowns, legs)
    derivative[:, unknowns.columns(*LINKS)] = moments @ unknowns.of_links
    model = moments @ unknowns.model_links
    for link, (leg, place) in enumerate(chains):
        model[5 * link + 4] = legs.reach[leg, place]
        number = place - (legs.joints.shape[1] - 2)  # 0 of a thigh, 1 of a calf
        for name, which in (("link_length", 2 * leg + number), ("link_length_common", number)):
            if number >= 0 and unknowns.estimates(name):
                derivative[5 * link + 4, unknowns.columns(name)[which]] = 1.0
    return model, derivative


def _by_parameters(unknowns: Unknowns, legs: LegChains) -> FloatArray:
    """(5 links, 4 links) masses and first moments by the factors and moments that `momenta` has; zero for lengths."""
    robot = unknowns.robot
    bodies = [robot.pinocchio.inertias[joint] for leg in robot.legs.values() for joint in leg.joint_ids]
    matrix = np.zeros((5 * legs.links, 4 * legs.links))
    for link, body in enumerate(bodies):
        matrix[5 * link : 5 * link + 4, link] = body.mass * np.array([1.0, *body.lever])
        matrix[5 * link + 1 : 5 * link + 4, legs.links + 3 * link : legs.links + 3 * link + 3] = np.eye(3)
    return matrix
