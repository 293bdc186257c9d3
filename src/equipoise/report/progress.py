"""How the precise method's intervals narrowed, motion by motion."""

from __future__ import annotations

import math

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.posterior_evidence import PosteriorEvidence
from equipoise.estimator.problem import Posterior, body_jacobian
from equipoise.report.blocks import Block, axes, figure, line
from equipoise.result.calibration import Calibration
from equipoise.result.statistics import NORMAL_95
from equipoise.robot.inertial import COMPONENTS, components


def progress_figures(result: Calibration) -> Block | None:
    """Half the 95 % intervals of CoM and moments against robot time; None without a posterior."""
    evidence = result.evidence
    if not isinstance(evidence, PosteriorEvidence):
        return None
    posterior = evidence.posterior
    durations = [motion.duration for motion in evidence.motions]
    deviation = deviations_by_motion(posterior, [motion.index for motion in evidence.motions])
    time = np.cumsum([0.0, *durations])
    half = NORMAL_95 * deviation
    body = components(posterior.robot_body)
    caption = "By what each motion told, added up in the order in which they were done."
    com = [line(time, 1000 * half[:, k], f"CoM {COMPONENTS[k][-1]}", k - 1) for k in (1, 2, 3)]
    inertia = [line(time, 100 * half[:, k] / body[k], COMPONENTS[k], k - 4) for k in (4, 5, 6)]
    return {
        "type": "figures",
        "figures": [
            figure("How the centre of mass became known", caption, com, _log("95 % \u00b1 [mm]", 1000 * half[:, 1:4])),
            figure(
                "How the moments became known",
                caption,
                inertia,
                _log("95 % \u00b1 [%]", 100 * half[:, 4:7] / body[4:7]),
            ),
        ],
    }


def deviations_by_motion(posterior: Posterior, motions: list[int]) -> FloatArray:
    """(n + 1, 10) standard deviations of the whole robot's parameters before the first and after each of n motions."""
    to_body = body_jacobian(posterior.unknowns, posterior.x, posterior.unknowns.robot_body)
    information = np.linalg.inv(posterior.covariance) - sum(posterior.information.values())
    path: list[FloatArray] = []
    for added in [None, *motions]:
        information = information + (0.0 if added is None else posterior.information.get(added, 0.0))
        path.append(np.sqrt(np.diag(to_body @ np.linalg.inv(information) @ to_body.T)))
    return np.array(path)


def _log(label: str, values: FloatArray) -> Block:
    """A layout with a logarithmic axis that reads 1, 2, 5, 10, 20, 50; Plotly's own leaves out the noughts."""
    layout = axes("robot time [s]", label)
    decades = range(math.floor(math.log10(values.min())), math.ceil(math.log10(values.max())) + 1)
    ticks = [digit * 10.0**decade for decade in decades for digit in (1, 2, 5)]
    layout["yaxis"] |= {"type": "log", "tickvals": ticks, "ticktext": [f"{tick:g}" for tick in ticks]}
    return layout
