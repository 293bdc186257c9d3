"""Estimated masses, first moments and lengths of the moving leg links."""

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
    """Return the moving leg links by name, each quantity with its prior.

    A link's inertia scales with its mass: no motion of a standing robot determines it.

    Args:
        x: (size,) estimate.
        covariance: (size, size) posterior covariance of x.
    """
    robot, legs = unknowns.robot, unknowns.legs
    model, derivative = _at_the_model(unknowns, legs)
    values = model + derivative @ (x * unknowns.scale)
    combined_priors = np.eye(unknowns.size)
    combined_priors[unknowns.tabled, unknowns.tabled] = unknowns.tabled_prior.covariance
    rows = derivative * unknowns.scale
    before, after = (np.einsum("ij,jk,ik->i", rows, spread, rows) for spread in (combined_priors, covariance))
    # A common offset of the CoMs along the joint axes is not estimated: its variance shrinks as that of the link's own offset.
    along = _along_axes(unknowns, legs)
    left = np.divide(after, before, out=np.ones_like(after), where=before > 0)
    before, after = np.sqrt(before + along), np.sqrt(after + left * along)
    names = link_names(robot.full_pinocchio)
    joints = [name for leg in robot.legs.values() for name in leg.joint_names]
    per_link = zip(*(array.reshape(-1, 5) for array in (values, after, before, model)), strict=True)
    return {
        names[robot.full_pinocchio.getJointId(joint)]: Link(**_quantities(*arrays))
        for joint, arrays in zip(joints, per_link, strict=True)
    }


def _along_axes(unknowns: Unknowns, legs: LegChains) -> FloatArray:
    """Return the (5 links,) variance of the first moments from common CoM offsets along the joint axes."""
    variance = np.zeros((legs.links, 5))
    if unknowns.estimates("link_com_common"):
        std = legs.mass.reshape(-1, 1) * unknowns.scale[unknowns["link_com_common"]][0]
        variance[:, 1:4] = (std * legs.axes.reshape(-1, 3, 3)[:, :, 2]) ** 2
    return variance.ravel()


def _quantities(values: FloatArray, after: FloatArray, before: FloatArray, model: FloatArray) -> dict[str, Quantity]:
    """Return the estimated quantities of one link."""
    return {
        name: Quantity(name, unit, float(value), float(std), verdict_of(float(std), float(prior)), float(nominal))
        for name, unit, value, std, prior, nominal in zip(_NAMES, _UNITS, values, after, before, model, strict=True)
        if prior > 0
    }


def _at_the_model(unknowns: Unknowns, legs: LegChains) -> tuple[FloatArray, FloatArray]:
    """Return the (5 links,) values of _NAMES in the model, and their (5 links, size) derivative by x / scale."""
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
    """Return the (5 links, 4 links) matrix from the factors and moments of `momenta` to the values of _NAMES; lengths: 0."""
    robot = unknowns.robot
    bodies = [robot.pinocchio.inertias[joint] for leg in robot.legs.values() for joint in leg.joint_ids]
    matrix = np.zeros((5 * legs.links, 4 * legs.links))
    for link, body in enumerate(bodies):
        matrix[5 * link : 5 * link + 4, link] = body.mass * np.array([1.0, *body.lever])
        matrix[5 * link + 1 : 5 * link + 4, legs.links + 3 * link : legs.links + 3 * link + 3] = np.eye(3)
    return matrix
