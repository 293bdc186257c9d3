"""Intermediate estimates of the Bayesian method: the posterior after each trial."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.estimator.equations.equation import MotionSamples
from equipoise.estimator.measurements.support_planes import support_planes
from equipoise.estimator.motions import read_motions
from equipoise.estimator.prior_runs.changes import estimate_with_prior_run
from equipoise.estimator.prior_runs.prior_run import PriorRun
from equipoise.estimator.unknowns import Priors
from equipoise.method.reading import ComEstimate, LiftPlane
from equipoise.recording.recording import Recording
from equipoise.result.statistics import NORMAL_95
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance


def planes_through_com(robot: RobotModel, com: FloatArray, motions: Sequence[MotionSamples]) -> list[LiftPlane]:
    """Return the plane in which each lift places the CoM, with everything else from the model.

    Args:
        robot: model of everything else.
        com: (3,) CoM of that model at the nominal stance, in the base frame [m].
        motions: samples of the trials.
    """
    lifts = {motion.index: motion.lift for motion in motions if motion.lift}
    planes = support_planes(robot, com, list(lifts.values()))
    return [LiftPlane(index, lift.pair, plane) for (index, lift), plane in zip(lifts.items(), planes, strict=True)]


class BayesianReading:
    """Implementation of `equipoise.method.reading.Reading`."""

    def __init__(
        self,
        robot: RobotModel,
        stance: Stance,
        recordings: Sequence[Recording],
        priors: Priors,
        scale: tuple[float, float] | None,
        prior_run: PriorRun | None = None,
    ) -> None:
        self._prior_run = prior_run
        self._robot, self._stance, self._priors, self._scale = robot, stance, priors, scale
        self._motions = read_motions(robot, stance, recordings)

    def planes(self) -> list[LiftPlane]:
        """Return the `planes_through_com` of all lifts."""
        com = composite_parameters(self._robot, self._stance.joint_position).com
        return planes_through_com(self._robot, com, self._motions)

    def estimate(self, trials: int) -> ComEstimate:
        """Estimate the CoM from the first trials."""
        motions = self._motions[:trials]
        lifts = any(motion.lift for motion in motions)
        posterior, _ = estimate_with_prior_run(
            self._robot, self._stance, motions, self._priors, self._scale, self._prior_run, lifts
        )
        covariance = posterior.robot_covariance[1:4, 1:4]
        return ComEstimate(trials, posterior.robot_body.com, NORMAL_95 * np.sqrt(np.diag(covariance)), covariance)
