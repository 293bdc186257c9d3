"""Where the CoM is, roughly and fast: a momentum Newton step per lift, about two lifts a diagonal.

Where a Newton step cannot be taken (the feet hardly leave the floor, the steps do not settle) Algorithm 1's bisection does.
"""

from __future__ import annotations

from collections.abc import Callable

from equipoise.bayesian.lift_design import LiftDesign
from equipoise.bayesian.safe_lift import doubt_after_a_lift
from equipoise.bayesian.trials import BayesianTrials
from equipoise.errors import ReachError
from equipoise.estimator.measurements.support_planes import CentreShift, centre_shift
from equipoise.estimator.motions import read_motions
from equipoise.recording.phases import Phase
from equipoise.recording.recording import Recording
from equipoise.robot.inertial import InertialParameters, base_parameters, composite_parameters
from equipoise.robot.model import DIAGONALS, RobotModel
from equipoise.robot.posture import BodyPosture
from equipoise.robot.statics import carried_mass

_LEAST_BASE = 0.3  # of the model's
_MOST_LIFTS = 4  # per diagonal
_SETTLED = 0.003  # [m] on an A1: a step this small places the rest of the lifts well enough
_NEAR = 0.010  # [m] on an A1: a step this small is right to a millimetre where sensors are known
_FARTHEST = 0.08  # [m] on an A1: a CoM farther off than this is no Newton step
_MASS_KNOWN = 0.04  # what joint torques at rest say of the mass counts beyond this fraction: gains and friction


def find_com_fast(trials: BayesianTrials, report: Callable[[str], None], sure: bool = False) -> None:
    """The planar CoM by lifts on both diagonals; `trials.com` and the robot under command follow as it is found.

    Args:
        report: function that is told the diagonal before every lift.
        sure: whether the sensors are known: one lift a diagonal does then, unless the CoM was far from where it was thought.
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
                break  # the step before has to do
            shift = _newton_step(trials, recording)
            if shift is None or abs(shift.distance) > _FARTHEST * size:
                _bisect(trials, diagonal)
                break
            _follow(trials, model, recording, shift)
            if (sure or attempt > 0) and abs(shift.distance) < (_NEAR if sure else _SETTLED) * size:
                break


def _newton_step(trials: BayesianTrials, recording: Recording) -> CentreShift | None:
    robot, stance = trials.standing.robot, trials.stance
    lift = read_motions(robot, stance, [recording])[0].lift
    return None if lift is None else centre_shift(robot, lift)


def _follow(trials: BayesianTrials, model: RobotModel, recording: Recording, shift: CentreShift) -> None:
    """Move the CoM that is commanded with to where the lift says, and take the mass that the torques carry."""
    horizontal = shift.normal * [1, 1, 0]
    # Only what lies across the line was measured: the shift goes along its horizontal normal.
    trials.com = trials.com + shift.distance * horizontal / float(horizontal @ horizontal)
    trials.doubt = doubt_after_a_lift(trials.stance, trials.doubt, horizontal)
    trials.standing.robot = loaded_robot(model, trials, _carried(model, recording))


def _carried(model: RobotModel, recording: Recording) -> float:
    rest = recording.phase(Phase.REST).joints
    if rest.torque is None:
        return model.mass
    mass = carried_mass(model, rest.position.mean(axis=0), rest.torque.mean(axis=0))
    return mass if abs(mass / model.mass - 1) > _MASS_KNOWN and mass > 0.5 * model.mass else model.mass


def loaded_robot(model: RobotModel, trials: BayesianTrials, mass: float) -> RobotModel:
    """The model with a base that gives the whole robot a mass and, at the nominal stance, a CoM."""
    base = base_parameters(model)
    whole = composite_parameters(model, trials.stance.joint_position)
    # Without a scale little is known of the mass: of the base something is left.
    base_mass = max(base.mass + mass - whole.mass, _LEAST_BASE * base.mass)
    mass = whole.mass + base_mass - base.mass
    moment = mass * trials.com - (whole.mass * whole.com - base.mass * base.com)
    loaded = InertialParameters(base_mass, moment / base_mass, base.inertia * base_mass / base.mass)
    return model.with_base(loaded.to_pinocchio())


def _bisect(trials: BayesianTrials, diagonal: str) -> None:
    """Algorithm 1 on one diagonal; the CoM moves to the plane that it finds."""
    from equipoise.paper.com_search import find_support_vector  # noqa: PLC0415 - few robots need it
    from equipoise.paper.settings import ComSearchSettings  # noqa: PLC0415
    from equipoise.paper.trial_runner import TrialRunner  # noqa: PLC0415

    settings = ComSearchSettings()
    runner = TrialRunner(trials.standing, trials.stance, settings)
    lower, upper = settings.bounds(trials.stance)
    vector = find_support_vector(runner, diagonal, upper, lower)
    plane = vector.lifts[-1].plane
    distance = plane.distance_to(trials.com)
    horizontal = plane.normal * [1, 1, 0]
    trials.com = trials.com - distance * horizontal / float(horizontal @ horizontal)
