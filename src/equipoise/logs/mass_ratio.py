"""Mass of a robot that walks with a payload, from the loads on its feet over those in a bare walk, as in the prior run.

Over whole gait cycles the mean force on the feet is the mass times the mean specific force. The first is from joint torques,

    J^T f = tau_legs - (g tau - F_c tanh(v / v_0) - F_v v),

with gains g and friction of the prior run, the second from the accelerometer. Errors of torques, legs and accelerometer are
those of both walks and cancel in the ratio; friction depends on the gait and would not.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.errors import RecordingError
from equipoise.estimator.diagnostics.torque_mass import torque_constants
from equipoise.estimator.equations.torque_balance import STICTION_SPEED
from equipoise.estimator.prior_runs.prior_run import PriorRun
from equipoise.estimator.unknowns import Values
from equipoise.logs.motions.loads import vertical_forces
from equipoise.logs.motions.segments import LogSegment
from equipoise.logs.motions.track import Track
from equipoise.recording.trials import WalkTrial
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import Stance, nominal_stance

_SHORTEST = 1.0  # [s] on an A1 of a piece of walking: two gait cycles
_FEWEST, _MOST = 4, 30  # pieces of 2 s
# Systematic error of the ratio, std: 0.1 % between simulated trots that differ in period, speed and step height; without the
# prior run's friction 0.5 %.
_SYSTEMATIC = 1e-3


def mass_by_ratio(
    robot: RobotModel, prior_run: PriorRun, walk: Sequence[LogSegment], bare: Sequence[LogSegment]
) -> tuple[float, float]:
    """Return the mass of the whole robot in a walk and its standard deviation, without the error of the prior run's mass [kg].

    Args:
        walk, bare: segments of the logs of a walk, and of one of the robot as it was in the prior run.

    Raises:
        RecordingError: a log has no joint torques, or too little walking; the torques in the bare log do not carry the robot
            of the prior run.
        SettingsError: the prior run is of another robot.
    """
    prior_run.check(robot)
    stance = nominal_stance(robot)
    values = prior_run.values(robot, stance)
    carried = [
        _carried_masses(robot, stance, segments, values, which)
        for which, segments in (("the log", walk), ("the bare log", bare))
    ]
    loaded, unloaded = (masses.mean() for masses in carried)
    mass, limit = prior_run.mass(robot, stance), torque_constants(robot, stance, prior_run)[1]
    if abs(unloaded / mass - 1) > limit:
        raise RecordingError(
            f"the joint torques in the bare log carry {unloaded:.2f} kg, but the robot of {prior_run.name} has {mass:.2f} kg "
            f"(allowed {limit:.0%}): it is another robot, or carries another payload; use a walk of the robot as it was then"
        )
    ratio = loaded / unloaded
    relative = np.sqrt(sum(_variance_of_mean(masses / masses.mean()) for masses in carried) + _SYSTEMATIC**2)
    return float(ratio * mass), float(ratio * mass * relative)


def _carried_masses(
    robot: RobotModel, stance: Stance, segments: Sequence[LogSegment], values: Values, which: str
) -> FloatArray:
    """Return the (n,) masses that the joint torques carry in pieces of walking [kg].

    The weights of a piece's samples vanish at its ends (Hann window), so that it need not hold whole gait cycles.
    """
    recordings = [one.recording for one in segments if one.recording is not None]
    walks = [(one, one.trial.steps) for one in recordings if isinstance(one.trial, WalkTrial)]
    if walks and walks[0][0].joints.torque is None:
        raise RecordingError(f"{which} has no joint torques: record them, or weigh the robot and pass --mass KG")
    found: list[float] = []
    for recording, steps in walks[:: max(1, len(walks) // _MOST)]:
        start, end = steps[0].start, steps[-1].end
        if end - start > _SHORTEST * stance.scale.time:
            track = Track.of(robot, recording.between(start, end), stance.scale.time)
            weights = np.hanning(len(track.time))
            found.append(float(weights @ _load(robot, track, values) / (weights @ track.acceleration_in_base[:, 2])))
    if len(found) < _FEWEST:
        piece = 2 * stance.scale.time
        raise RecordingError(
            f"{which} has {piece * len(found):.0f} s of usable walking; at least {piece * _FEWEST:.0f} s are needed"
        )
    return np.array(found)


def _load(robot: RobotModel, track: Track, values: Values) -> FloatArray:
    """Return the (n,) force on the feet along the base's z axis, by the joint torques [N]."""
    assert track.joint_torque is not None  # as the caller has checked
    velocity = np.gradient(track.joint_position, track.time, axis=0)
    friction = values["coulomb_friction"] * np.tanh(velocity / STICTION_SPEED) + values["viscous_friction"] * velocity
    torque = (1 + values["torque_gain_common"] + values["torque_gain"]) * track.joint_torque - friction
    return vertical_forces(robot, track.joint_position, torque).sum(axis=1)


def _variance_of_mean(values: FloatArray) -> float:
    """Return the variance of the mean of (n,) values, that of Student's t with n - 1 degrees of freedom."""
    count = len(values)
    return float(values.var(ddof=1)) / count * (count - 1) / (count - 3)
