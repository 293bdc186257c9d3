"""Where the uncertainty of a result comes from: a budget, as the Guide to the Expression of Uncertainty in Measurement has it.

With the information L = sum of L_k of all sources (priors of groups of unknowns, the scale, the noise of each kind of
measurement), the covariance C = L^-1 = sum of C L_k C: each term is what the errors of one source do to the estimate, and
they add up to all of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.blocks.block import ResidualBlock
from equipoise.estimator.blocks.leg_swing import LegSwingBlock
from equipoise.estimator.blocks.planted import PlantedBlock
from equipoise.estimator.blocks.sway import SwayBlock
from equipoise.estimator.blocks.tilt import TiltBlock
from equipoise.estimator.blocks.torque import TorqueBlock
from equipoise.estimator.problem import Posterior, body_jacobian, body_prior_rows
from equipoise.result.uncertainty import UncertaintySource

_SCALE, _TIME = "a scale (--mass)", "more robot time (--budget)"


@dataclass(frozen=True)
class _Group:
    """Rows of the table of unknowns that people think of as one, and what would make less of their errors."""

    name: str
    rows: tuple[str, ...]
    remedy: str


GROUPS = (
    _Group(
        "masses and CoMs of the legs", ("leg_mass", "leg_mass_common", "link_com", "link_com_common"),
        "--legs trusted, where the model file's legs were weighed",
    ),
    _Group(
        "lengths of the legs, hips, foot radii",
        ("link_length", "link_length_common", "hip_position", "foot_radius", "foot_radius_each"),
        "--legs trusted, where they were measured",
    ),
    _Group(
        "joint zeros, springs and play", ("joint_zero", "compliance", "play", "eccentricity"),
        "more robot time (--budget); a jig for the zeros (--priors)",
    ),
    _Group(
        "IMU: mounting, gains, biases, clock",
        (
            "imu_tilt", "imu_position", "accelerometer_bias", "accelerometer_gain", "accelerometer_drift", "gyro_drift",
            "gyro_gain", "gyro_misalignment", "clock_offset",
        ),
        _TIME,
    ),
    _Group("a cable's pull", ("pull",), "--cable none, where there is none; --turn"),
    _Group(
        "feet and floor", ("rolling", "sag", "floor_slope", "floor_warp", "foothold_change"), "a hard, level floor; --turn"
    ),
    _Group(
        "torque constants, friction, rotors",
        ("torque_gain_common", "torque_gain", "coulomb", "rotor_spin", "viscous", "armature"), _SCALE,
    ),
)  # fmt: skip
_BLOCKS: tuple[tuple[type[ResidualBlock], str, str], ...] = (
    (TiltBlock, "noise of the lifts", _TIME),
    (PlantedBlock, "noise of moves over planted feet", "more robot time (--budget); a hard floor"),
    (TorqueBlock, "noise of joint torques", _SCALE),
    (LegSwingBlock, "noise of legs that swing in the air", "a longer swing (--motor-time)"),
    (SwayBlock, "where the sway sees the IMU", "the IMU's measured place, in the robot's description"),
)


def budget_of(posterior: Posterior) -> tuple[UncertaintySource, ...]:
    """Shares of each source in the variance of the whole robot's parameters, the largest sum first."""
    jacobian = body_jacobian(posterior.unknowns, posterior.x, posterior.unknowns.robot_body)
    reach = jacobian @ posterior.covariance
    variance = np.diag(posterior.robot_covariance)
    found = [
        UncertaintySource(name, np.einsum("ij,jk,ik->i", reach, information, reach) / variance, remedy)
        for name, information, remedy in _sources(posterior, {_SCALE: _TIME} if posterior.problem.mass else {})
    ]
    return tuple(sorted(found, key=lambda source: -float(source.shares.sum())))


def _sources(posterior: Posterior, instead: Mapping[str, str]) -> Iterator[tuple[str, FloatArray, str]]:
    """Name, (size, size) information and remedy of each source that there is.

    Args:
        instead: remedies that were taken already, and what else there is.
    """
    unknowns, x, mass = posterior.unknowns, posterior.x, posterior.problem.mass
    believed = _information(body_prior_rows(unknowns, x, None)[1])
    yield "what was believed of the base", believed, _TIME
    if mass is not None:
        yield "the scale", _information(body_prior_rows(unknowns, x, mass)[1]) - believed, "a better scale (--mass-sd)"
    if unknowns.belief is not None:
        information = np.zeros((unknowns.size, unknowns.size))
        information[unknowns.tabled, unknowns.tabled] = unknowns.belief.information
        yield "what the earlier run left open, and what may have changed since", information, _TIME
    for group in GROUPS if unknowns.belief is None else ():
        columns = unknowns.columns(*(row for row in group.rows if unknowns.estimates(row)))
        if len(columns):
            information = np.zeros((unknowns.size, unknowns.size))
            information[columns, columns] = 1.0
            yield group.name, information, instead.get(group.remedy, group.remedy)
    for kind, name, remedy in _BLOCKS:
        if kind in posterior.information_by_kind:
            yield name, posterior.information_by_kind[kind], instead.get(remedy, remedy)


def _information(jacobian: FloatArray) -> FloatArray:
    return np.asarray(jacobian.T @ jacobian, dtype=float)
