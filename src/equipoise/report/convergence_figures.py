"""Figures of the convergence of the Bayesian method: intervals after each motion."""

from __future__ import annotations

import math

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.posterior_evidence import PosteriorEvidence
from equipoise.estimator.problem import Posterior, body_jacobian
from equipoise.figures.blocks import Figure, Trace, axes, line
from equipoise.result.calibration import Calibration
from equipoise.result.statistics import NORMAL_95
from equipoise.robot.inertial import COMPONENTS, components


def progress_figures(result: Calibration) -> list[Figure]:
    """Return half widths of the 95 % intervals of CoM and moments against robot time; empty without a posterior."""
    evidence = result.evidence
    if not isinstance(evidence, PosteriorEvidence):
        return []
    posterior = evidence.posterior
    std = stds_by_motion(posterior, [motion.index for motion in posterior.motions])
    time = np.cumsum([0.0, *(motion.duration for motion in posterior.motions)])
    com = 1000 * NORMAL_95 * std[:, 1:4]
    inertia = 100 * NORMAL_95 * std[:, 4:7] / components(posterior.robot_body)[4:7]
    shown = (
        ("Convergence of the centre of mass", com, ("CoM x", "CoM y", "CoM z"), "95 % \u00b1 [mm]"),
        ("Convergence of the moments of inertia", inertia, COMPONENTS[4:7], "95 % \u00b1 [%]"),
    )
    caption = "Half widths of the 95 % intervals, from the information of all motions up to each time."
    return [
        Figure(title, caption, [line(time, half[:, k], name, k) for k, name in enumerate(names)], _log(label, half))
        for title, half, names, label in shown
    ]


def stds_by_motion(posterior: Posterior, motions: list[int]) -> FloatArray:
    """Return (n + 1, 10) standard deviations of the whole robot's parameters, before the first and after each motion."""
    to_body = body_jacobian(posterior.unknowns, posterior.x, posterior.unknowns.robot_body)
    information = np.linalg.inv(posterior.covariance) - sum(posterior.information.values())
    path: list[FloatArray] = []
    for added in [None, *motions]:
        information = information + (0.0 if added is None else posterior.information.get(added, 0.0))
        path.append(np.sqrt(np.diag(to_body @ np.linalg.inv(information) @ to_body.T)))
    return np.array(path)


def _log(label: str, values: FloatArray) -> Trace:
    """Return a layout with a logarithmic axis labelled 1, 2, 5, 10, 20, 50: Plotly's default omits the zeros."""
    layout = axes("robot time [s]", label)
    decades = range(math.floor(math.log10(values.min())), math.ceil(math.log10(values.max())) + 1)
    ticks = [digit * 10.0**decade for decade in decades for digit in (1, 2, 5)]
    layout["yaxis"] |= {"type": "log", "tickvals": ticks, "ticktext": [f"{tick:g}" for tick in ticks]}
    return layout
