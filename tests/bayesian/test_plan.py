"""Plans of the Bayesian method, and their predicted motions."""

import dataclasses
import itertools
import json
import warnings

import cases
import numpy as np
import pytest
from robots import load_text, quadruped_urdf
from tilting import rolling_feet

from equipoise import BayesianMethod, nominal_stance
from equipoise.bayesian.goals import Goals
from equipoise.bayesian.lift_design import LiftDesign
from equipoise.bayesian.plan import Durations, make_plan, name_components
from equipoise.bayesian.planning.candidates import Candidates, describe
from equipoise.bayesian.planning.gains import Steps
from equipoise.bayesian.predict import Predictor
from equipoise.errors import ReachError, SettingsError
from equipoise.estimator.equations.equation import MotionSamples
from equipoise.estimator.equations.table import USUAL
from equipoise.estimator.equations.tilt import TiltEquation
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.measurements.lift_samples import attitudes
from equipoise.estimator.problem import body_jacobian, estimate_posterior, prior_rows
from equipoise.estimator.unknowns import Priors
from equipoise.recording.trials import DesignedLift, PostureTrial
from equipoise.robot.inertial import COMPONENTS, components, composite_parameters
from equipoise.robot.kinematics import foot_positions
from equipoise.robot.model import DIAGONALS, LEG_NAMES
from equipoise.robot.posture import BodyPosture

BUDGETS = (30.0, 45.0, 60.0, 90.0, 120.0)


def candidates_of(robot, aside=0.0, combined_priors=None):
    """Return candidates with the CoM that far to the left of the model's [m]."""
    stance = nominal_stance(robot)
    com = composite_parameters(robot, stance.joint_position).com + [0, aside, 0]
    return Candidates.of(robot, stance, com, combined_priors or Priors())


@pytest.fixture(scope="module")
def candidates(a1):
    return candidates_of(a1)


@pytest.fixture(scope="module")
def narrow(a1):
    """Candidates of an A1 whose legs and IMU equal its model file, without a cable."""
    return candidates_of(
        a1, combined_priors=BayesianMethod(leg_prior="narrow", cable="none").combined_priors.holding("imu_position")
    )


@pytest.fixture(scope="module")
def plans(candidates):
    return {budget: make_plan(candidates, budget) for budget in BUDGETS}


@pytest.fixture(scope="module")
def solo_like(tmp_path_factory):
    """Robot with two joints per leg and a CoM in the middle."""
    text = quadruped_urdf(joints_per_leg=2)
    assert 'xyz="0.01 0.002 0.005"' in text
    return load_text(tmp_path_factory.mktemp("solo"), text.replace('xyz="0.01 0.002 0.005"', 'xyz="0.01 0 0.005"'))


def worth(plan, stance):
    """Return the sum of variances over squared goals, which plans minimize."""
    return float(np.sum((plan.std / Goals().vector(plan.body, stance)) ** 2))


# --- predicted accuracy


def test_a_larger_budget_never_predicts_worse(plans, candidates):
    worths = [worth(plans[budget], candidates.predictor.stance) for budget in BUDGETS]
    assert all(more < 0.99 * less for less, more in itertools.pairwise(worths))
    for less, more in itertools.pairwise(BUDGETS[1:]):
        assert (plans[more].std <= 1.05 * plans[less].std).all()


def test_a_plan_fits_its_budget_and_uses_it(plans, candidates):
    durations = Durations.of(candidates.predictor.stance)
    for budget, plan in plans.items():
        assert budget - durations.lift - durations.posture - durations.replant < plan.robot_time <= budget
        doing = len(plan.visits) * durations.posture + plan.lifts * durations.lift + durations.search + durations.end
        replanting = durations.replant * sum(bool(visit.lifts) for visit in plan.visits)
        assert doing - 1e-9 < plan.robot_time < doing + replanting + 1e-9


@pytest.mark.parametrize("budget", [5.0, 12.0])
def test_too_small_a_budget_is_rejected_with_the_smallest(candidates, budget):
    with pytest.raises(SettingsError, match=rf"{budget:.0f} s allows no lift after the search; give \d+ s or more"):
        make_plan(candidates, budget)


def test_the_smallest_budget_of_the_error_is_sufficient(candidates):
    with pytest.raises(SettingsError) as error:
        make_plan(candidates, 10.0, reserved=3.3)
    least = float(str(error.value).split("give ")[1].split(" s")[0])
    assert make_plan(candidates, least, reserved=3.3).lifts >= 1
    with pytest.raises(SettingsError):
        make_plan(candidates, least - 1, reserved=3.3)


def test_updated_steps_equal_new_steps(candidates):
    size = candidates.unknowns.size
    random = np.random.default_rng(4)
    weights, covariance = random.normal(size=(10, size)), np.eye(size)
    steps, costs = Steps(candidates, covariance, weights), dict.fromkeys(range(len(candidates.rows)), 1.0)
    visited = set()
    for _ in range(3):
        gain, best = steps.best(costs, visited)
        taken = steps.rows(steps.parts(best, visited))
        visited.add(steps._posture[best])
        steps.update(taken, covariance)
        covariance = np.linalg.inv(np.linalg.inv(covariance) + taken.T @ taken)
        expected, same = Steps(candidates, covariance, weights).best(costs, visited)
        gain, best = steps.best(costs, visited)
        assert (best, gain) == (same, pytest.approx(expected, rel=1e-7))


def prior_std(candidates):
    """Return the (10,) standard deviations of the whole robot's parameters before any motion, with a mass from a scale."""
    unknowns, mass = candidates.unknowns, candidates.predictor.robot.mass
    _, rows = prior_rows(unknowns, unknowns.start(), (mass, 0.005 * mass))
    to_body = body_jacobian(unknowns, unknowns.start(), unknowns.robot_body)
    return np.sqrt(np.diag(to_body @ np.linalg.inv(rows.T @ rows) @ to_body.T))


def test_lifts_reduce_the_prior_std(candidates, plans, narrow):
    for plan, of, most in ((plans[120.0], candidates, 0.22), (make_plan(narrow, 120.0), narrow, 0.1)):
        assert (plan.std < prior_std(of)).all()
        ratios = dict(zip(COMPONENTS, plan.std / prior_std(of), strict=True))
        assert max(ratios[name] for name in ("com_x", "com_y", "com_z")) < 0.1
        assert max(ratios[name] for name in ("Ixx", "Iyy", "Izz")) < most
        # Mass shows in no lift: it is taken from a scale.
        assert plan.std[0] == pytest.approx(0.005 * plan.body[0], rel=0.2)


def test_narrow_legs_and_no_cable_improve_the_accuracy(plans, narrow):
    ratios = make_plan(narrow, 120.0).std / plans[120.0].std
    assert (ratios < 1).all()
    assert (ratios[1:7] < 0.9).all()
    assert ratios[3] < 0.5  # the height of the CoM


def test_no_lift_is_repeated(candidates, plans):
    lifts = [lift for visit in plans[120.0].visits for lift in visit.lifts]
    assert len(lifts) == len(set(lifts)) == plans[120.0].lifts
    assert all(lift.posture == visit.posture for visit in plans[120.0].visits for lift in visit.lifts)
    again = make_plan(candidates, 60.0, used=lifts)
    assert not {lift for visit in again.visits for lift in visit.lifts} & set(lifts)


def test_few_possible_lifts_are_repeated(candidates):
    few = dataclasses.replace(
        candidates,
        lifts=candidates.lifts[:2],
        rows=[*candidates.rows[:2], *candidates.rows[len(candidates.lifts) :]],
    )
    lifts = [lift for visit in make_plan(few, 60.0).visits for lift in visit.lifts]
    assert [lifts.count(lift) for lift in few.lifts] == [5, 5]
    left = [lift for visit in make_plan(few, 60.0, used=lifts[:8]).visits for lift in visit.lifts]
    assert sorted(map(repr, left + lifts[:8])) == sorted(map(repr, lifts))


def test_visits_with_lifts_come_first(plans):
    has_lifts = [bool(visit.lifts) for visit in plans[120.0].visits]
    assert has_lifts == sorted(has_lifts, reverse=True)
    assert not all(has_lifts)  # stance motions are worth their time too


def test_plans_depend_on_their_goals(narrow):
    """Each of two plans, for the CoM and for the moments of inertia, is better for its own goal."""
    centre = make_plan(narrow, 60.0, Goals(com_planar=1e-4, com_height=1e-4, mass=1e3, inertia=1e3, products=1e3))
    moments = make_plan(narrow, 60.0, Goals(com_planar=1.0, com_height=1.0, mass=1e3, inertia=1e-3, products=1e3))
    assert np.linalg.norm(centre.std[1:4]) < 0.95 * np.linalg.norm(moments.std[1:4])
    whole = centre.body[4:7]
    assert np.linalg.norm(moments.std[4:7] / whole) < 0.95 * np.linalg.norm(centre.std[4:7] / whole)


def test_current_information_is_used(candidates, plans):
    after = make_plan(candidates, 30.0, known=1e12 * np.eye(candidates.unknowns.size))
    assert (after.std < 1e-3 * plans[30.0].std).all()


def test_a_replan_without_time_is_empty(candidates):
    known = np.eye(candidates.unknowns.size)
    assert make_plan(candidates, 1.0, known=known).visits == ()


def test_the_plan_is_json(plans):
    table = json.loads(json.dumps(plans[60.0].to_dict()))
    assert table["lifts"] == plans[60.0].lifts == sum(len(visit["lifts"]) for visit in table["visits"])
    assert (table["search_lifts"], table["excitation"]) == (2 * plans[60.0].search, plans[60.0].excitation)
    assert list(table["predicted_std"]) == list(COMPONENTS)
    assert table["predicted_std"] == name_components(plans[60.0].std)


class ZeroedTiltEquation(TiltEquation):
    """Tilt equation of predicted lifts."""

    def __init__(self, unknowns, samples):
        super().__init__(unknowns, samples)
        self.zero_at(unknowns.start())


def test_predicted_lifts_do_not_determine_the_common_scale_of_all_masses(candidates):
    unknowns, predictor = candidates.unknowns, candidates.predictor
    x, lifts = unknowns.start(), [(k, predictor.lift(lift)) for k, lift in enumerate(candidates.lifts[:20])]
    equation = ZeroedTiltEquation(unknowns, lifts)
    equation.prepare(x)
    residual, jacobian = equation.linearise(x)
    np.testing.assert_allclose(residual, 0, atol=1e-9)
    np.testing.assert_allclose(equation.residual(x), 0, atol=1e-9)
    by_x, inertial = unknowns.inertial_jacobian(x), unknowns.inertial(x)
    scaled = np.linalg.lstsq(by_x, inertial)[0]
    np.testing.assert_allclose(by_x @ scaled, inertial, atol=1e-9)
    assert np.abs(jacobian @ scaled[equation.columns]).max() < 1e-6 * np.abs(jacobian).max()


def test_the_predicted_std_is_near_that_of_the_run(a1, bayesian_run, candidates):
    """The std predicted for the run's lifts and moves is within a factor of 2.5."""
    lifts = [
        LiftDesign(trial.posture, trial.diagonal, trial.side, trial.turn)
        for trial in (recording.trial for recording in bayesian_run.recordings)
        if isinstance(trial, DesignedLift)
    ]
    postures = [
        trial.posture
        for trial in (recording.trial for recording in bayesian_run.recordings)
        if isinstance(trial, PostureTrial)
    ]
    moves = itertools.pairwise([BodyPosture(), *postures])
    predictor, equations = candidates.predictor, (ZeroedTiltEquation, *USUAL[1:])
    samples = [*map(predictor.lift, lifts), *itertools.starmap(predictor.move, moves)]
    motions = [MotionSamples(index, samples=(one,)) for index, one in enumerate(samples)]
    weighed = a1.mass, bayesian_run.result.composite.stds[0]
    predicted = estimate_posterior(a1, bayesian_run.stance, motions, mass=weighed, rounds=0, equations=equations)
    expected = predicted.robot_covariance
    ratio = bayesian_run.result.composite.stds / np.sqrt(np.diag(expected))
    assert (ratio[1:7] > 0.4).all()
    assert (ratio[1:7] < 2.5).all()


# --- goals, durations and words


def test_goals_scale_with_the_robot(a1, candidates, tmp_path):
    body = components(composite_parameters(a1, candidates.predictor.stance.joint_position))
    vector = Goals().vector(body, candidates.predictor.stance)
    large = load_text(
        tmp_path, quadruped_urdf().replace('0 0 -0.2"', '0 0 -0.4"').replace("0.0 0.0 -0.2", "0.0 0.0 -0.4")
    )
    tall = nominal_stance(large)
    ratio = tall.hip_height / candidates.predictor.stance.hip_height
    assert ratio > 1.9
    assert Goals().vector(body, tall)[1:4] == pytest.approx(ratio * vector[1:4])
    assert np.delete(Goals().vector(body, tall), [1, 2, 3]) == pytest.approx(np.delete(vector, [1, 2, 3]))
    doubled = Goals().vector(2 * body, candidates.predictor.stance)
    assert doubled[[0, 4, 5, 6, 7]] == pytest.approx(2 * vector[[0, 4, 5, 6, 7]])
    assert doubled[1:4] == pytest.approx(vector[1:4])
    assert vector[4:7] == pytest.approx(0.01 * body[4:7])
    assert vector[7:] == pytest.approx([0.01 * body[4]] * 3)
    slower = Durations.of(tall).lift / Durations.of(candidates.predictor.stance).lift
    assert slower == pytest.approx(np.sqrt(ratio), rel=1e-6)


@pytest.mark.parametrize(
    ("posture", "words"),
    [
        (BodyPosture(), "nominal"),
        (BodyPosture(roll=0.2, crouch=0.1), "roll +11 deg, crouch +0.10"),
        (BodyPosture(yaw=-0.3, aside=-0.1), "yaw -17 deg, aside -0.10"),
    ],
)
def test_postures_in_words(posture, words):
    assert describe(posture) == words


# --- robots that cannot do everything


def test_legs_of_two_joints_get_a_plan_without_roll_and_yaw(solo_like):
    candidates = candidates_of(solo_like)
    plan = make_plan(candidates, 60.0)
    assert plan.lifts > 4
    for visit in plan.visits:
        assert (visit.posture.roll, visit.posture.yaw, visit.posture.aside) == (0, 0, 0)
        assert all(lift.turn in (None, "pitch") for lift in visit.lifts)
    assert any(visit.posture.pitch for visit in plan.visits)
    assert any(text.startswith("roll +13 deg") and "foot misses its place" in text for text in plan.left_out)
    ratios = dict(zip(COMPONENTS, plan.std / prior_std(candidates), strict=True))
    assert max(ratios[name] for name in ("com_x", "com_y", "com_z", "Iyy")) < 0.3


def test_legs_of_two_joints_get_a_plan_with_the_com_aside_too(solo_like):
    assert make_plan(candidates_of(solo_like, aside=3e-3), 60.0).lifts > 4


def test_a_robot_without_possible_lifts_is_rejected(tmp_path):
    heavy = load_text(tmp_path, quadruped_urdf(trunk_mass=90.0))
    with pytest.raises(
        ReachError, match=r"the robot can do no lift of the Bayesian method: nominal: joint .* torque limit"
    ):
        candidates_of(heavy)


def test_postures_beyond_reach_are_tried_smaller(tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        robot = load_text(tmp_path, quadruped_urdf().replace('lower="-0.9" upper="0.9"', 'lower="-0.2" upper="0.2"'))
    rolls = {abs(lift.posture.roll) for lift in candidates_of(robot).lifts}
    assert 0 < max(rolls) < 0.22


# --- predicted motions


def predictor_of(robot):
    """Return the predictor of a robot that equals its model file."""
    stance = nominal_stance(robot)
    return Predictor(robot, stance, composite_parameters(robot, stance.joint_position).com)


@pytest.mark.parametrize("turn", [None, "roll", "pitch", "yaw"])
@pytest.mark.parametrize("name", ["a1", "skewed"])
def test_a_predicted_lift_keeps_its_stance_feet_where_they_are(request, name, turn):
    """In the world frame, from the predicted gyroscope; feet roll by a few millimetres at most."""
    robot = request.getfixturevalue(name)
    predictor = predictor_of(robot)
    posture = BodyPosture(roll=0.1, yaw=0.1, crouch=0.1)
    lift = predictor.lift(LiftDesign(posture, "FL_RR", 1, turn))
    mounting = np.array(robot.imu_in_base.rotation)
    time = lift.step * np.arange(len(lift.joint_position))
    to_rest = mounting @ attitudes(time, lift.angular_velocity_in_imu).as_matrix() @ mounting.T
    feet = np.einsum("nij,nlj->nli", to_rest, LegChains(robot).feet(lift.joint_position))
    left, right = lift.stance_feet
    line = feet[:, left] - feet[:, right]
    assert np.abs(line - line[0]).max() < 4e-3
    in_air = [leg not in DIAGONALS["FL_RR"] for leg in LEG_NAMES]
    first = foot_positions(robot, lift.joint_position[0])
    above = (first[in_air] @ posture.rotation[2]).min() - (first[~np.array(in_air)] @ posture.rotation[2]).max()
    assert above > 0.015
    np.testing.assert_allclose(lift.joint_velocity, np.gradient(lift.joint_position, lift.step, axis=0), atol=1e-9)
    up = np.einsum("nij,nj->ni", to_rest, lift.up_in_imu @ mounting.T)
    np.testing.assert_allclose(up, np.tile(posture.rotation[2], (len(up), 1)), atol=1e-9)
    assert (np.abs(lift.joint_velocity).max() > 0.3) == (turn is not None)


@pytest.mark.parametrize("turn", [None, "roll", "pitch", "yaw"])
@pytest.mark.parametrize("name", ["a1", "skewed"])
def test_the_accelerometer_of_a_predicted_lift_agrees_with_rolling_feet(request, name, turn):
    """Within 0.4 of up to 1.8 m/s2: feet are predicted as points, and spheres of 2 cm roll at 20 rad/s2."""
    robot = request.getfixturevalue(name)
    predictor = predictor_of(robot)
    lift = predictor.lift(LiftDesign(BodyPosture(roll=0.1, yaw=0.1, crouch=0.1), "FL_RR", 1, turn))
    mounting, time = np.array(robot.imu_in_base.rotation), lift.step * np.arange(len(lift.joint_position))
    to_rest = mounting @ attitudes(time, lift.angular_velocity_in_imu).as_matrix() @ mounting.T
    turning, up, acceleration = (
        part @ mounting.T for part in (lift.angular_velocity_in_imu, lift.up_in_imu, lift.acceleration_in_imu)
    )
    velocities = [
        rolling_feet(robot, lift.pair, *sample)[2]
        for sample in zip(lift.joint_position, lift.joint_velocity, turning, up, strict=True)
    ]
    of_base = np.gradient(np.einsum("nij,nj->ni", to_rest, velocities), time, axis=0)
    acceleration = np.einsum("nij,nj->ni", to_rest, acceleration - 9.81 * up)
    np.testing.assert_allclose(acceleration[2:-2], of_base[2:-2], atol=0.4)  # without one-sided differences


@pytest.mark.parametrize("side", [1, -1])
def test_a_predicted_robot_tips_to_where_its_com_is(a1, side):
    """With side 1 the line is ahead of the CoM, so the robot tips backward."""
    predictor = predictor_of(a1)
    lift = predictor.lift(LiftDesign(BodyPosture(), "FL_RR", side))
    assert np.sign(lift.angular_velocity_in_imu[-1, 1]) == -side  # pitch
    assert np.abs(lift.angular_velocity_in_imu[-1]).max() > 0.05


def test_a_robot_whose_hip_axes_meet_has_a_plan(tmp_path):
    robot = load_text(tmp_path, cases.urdf("0 0 0"))
    plan = make_plan(candidates_of(robot), 60.0)
    assert plan.lifts
    assert np.isfinite(plan.std).all()
