"""Fast, coarse search of the CoM: a momentum Newton step per lift, about two lifts per diagonal.

If no Newton step is possible (feet hardly leave the floor, steps do not converge), Algorithm 1's bisection replaces it.
"""

from __future__ import annotations

from collections.abc import Callable

from equipoise.bayesian.lift_design import LiftDesign
from equipoise.bayesian.safe_lift import covariance_after_lift
from equipoise.bayesian.trials import BayesianTrials
from equipoise.errors import ReachError
from equipoise.estimator.measurements.support_planes import support_planes
from equipoise.estimator.motions import read_motions
from equipoise.experiments.tilt import SupportPlane
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.robot.inertial import InertialParameters, base_parameters, composite_parameters
from equipoise.robot.model import DIAGONALS, RobotModel
from equipoise.robot.posture import BodyPosture
from equipoise.robot.statics import carried_mass

_LEAST_BASE = 0.3  # of the model's
_MOST_LIFTS = 4  # per diagonal
_SETTLED = 0.003  # [m] on an A1: after a step this small, the CoM is accurate enough for the other lifts
_NEAR = 0.010  # [m] on an A1: a step this small is accurate within a millimetre with calibrated sensors
_FARTHEST = 0.08  # [m] on an A1: largest Newton step that is accepted
_MASS_TOLERANCE = 0.04  # smaller differences of the mass from the torques are attributed to gains and friction


def find_com_fast(trials: BayesianTrials, report: Callable[[str], None], calibrated: bool = False) -> None:
    """Find the planar CoM by lifts on both diagonals, and update `trials.com` and the commanded robot model.

    Args:
        report: function that is called with the diagonal before every lift.
        calibrated: True if the sensors are calibrated: one lift per diagonal suffices then, unless its step is large.
    """
    model, size = trials.standing.robot, trials.stance.scale.length
    for diagonal in DIAGONALS:
        for attempt in range(_MOST_LIFTS):
            report(diagonal)
            side = 0 if attempt == 0 else 1
            try:
                recording = trials.lift(LiftDesign(BodyPosture(), diagonal, side))
            except ReachError:
                if attempt == 0:
                    raise
                break  # the previous step has to suffice
            plane = _measured_plane(trials, recording)
            if plane is None or (step := abs(plane.distance_to(trials.com))) > _FARTHEST * size:
                _bisect(trials, diagonal)
                break
            _follow(trials, model, recording, plane)
            if (calibrated or attempt > 0) and step < (_NEAR if calibrated else _SETTLED) * size:
                break


def _measured_plane(trials: BayesianTrials, recording: Recording) -> SupportPlane | None:
    robot, stance = trials.standing.robot, trials.stance
    lift = read_motions(robot, stance, [recording])[0].lift
    return None if lift is None else support_planes(robot, trials.com, [lift])[0]


def _follow(trials: BayesianTrials, model: RobotModel, recording: Recording, plane: SupportPlane) -> None:
    """Move the assumed CoM onto the measured plane, and set the mass to that carried by the joint torques."""
    _move_onto(trials, plane)
    trials.com_covariance = covariance_after_lift(trials.stance, trials.com_covariance, plane.normal * [1, 1, 0])
    trials.standing.robot = loaded_robot(model, trials, _carried(model, recording))


def _move_onto(trials: BayesianTrials, plane: SupportPlane) -> None:
    """Move the assumed CoM onto a plane along its horizontal normal: a lift measures the CoM across the line only."""
    horizontal = plane.normal * [1, 1, 0]
    trials.com = trials.com - plane.distance_to(trials.com) * horizontal / float(horizontal @ horizontal)


def _carried(model: RobotModel, recording: Recording) -> float:
    rest = recording.phase(Phase.REST).joints
    if rest.torque is None:
        return model.mass
    mass = carried_mass(model, rest.position.mean(axis=0), rest.torque.mean(axis=0))
    return mass if abs(mass / model.mass - 1) > _MASS_TOLERANCE and mass > 0.5 * model.mass else model.mass


def loaded_robot(model: RobotModel, trials: BayesianTrials, mass: float) -> RobotModel:
    """Return the model with its base changed so that the whole robot has `mass` and, at the nominal stance, `trials.com`."""
    base = base_parameters(model)
    whole = composite_parameters(model, trials.stance.joint_position)
    # Without a scale the mass is uncertain; the base must keep a positive mass.
    base_mass = max(base.mass + mass - whole.mass, _LEAST_BASE * base.mass)
    mass = whole.mass + base_mass - base.mass
    moment = mass * trials.com - (whole.mass * whole.com - base.mass * base.com)
    loaded = InertialParameters(base_mass, moment / base_mass, base.inertia * base_mass / base.mass)
    return model.with_base(loaded.to_pinocchio())


def _bisect(trials: BayesianTrials, diagonal: str) -> None:
    """Run Algorithm 1 on one diagonal, and move the CoM onto the plane that it finds."""
    from equipoise.paper.com_search import find_support_vector  # noqa: PLC0415 - few robots need it
    from equipoise.paper.settings import ComSearchSettings  # noqa: PLC0415
    from equipoise.paper.trial_runner import TrialRunner  # noqa: PLC0415

    settings = ComSearchSettings()
    runner = TrialRunner(trials.standing, trials.stance, settings)
    lower, upper = settings.bounds(trials.stance)
    _, lifts = find_support_vector(runner, diagonal, upper, lower)
    _move_onto(trials, lifts[-1].plane)
