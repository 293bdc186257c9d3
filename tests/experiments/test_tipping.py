"""Safe tilt of a robot on two feet: pendulum, edge of the feet, and time to lower them."""

import itertools
import warnings

import numpy as np
import pinocchio as pin
import pytest
import robots
from robots import load_text, quadruped_urdf
from scipy.integrate import solve_ivp
from scipy.spatial import ConvexHull
from tilting import pendulum

from equipoise import BayesianMethod, calibrate, load_robot, nominal_stance, simulate
from equipoise.bayesian import lift_design, safe_lift
from equipoise.bayesian.lift_design import LiftChecks, LiftDesign, offset_of
from equipoise.bayesian.safe_lift import covariance_after_lift, initial_covariance, search_covariance
from equipoise.bayesian.trials import BayesianTrials
from equipoise.errors import MissingDependencyError, ReachError
from equipoise.estimator.motions import read_motions
from equipoise.experiments import tipping
from equipoise.experiments.lift import tipping_from
from equipoise.experiments.motion import Target
from equipoise.experiments.posture import feet_in_posture
from equipoise.experiments.standing_robot import StandingRobot
from equipoise.experiments.tilt import line_axes
from equipoise.experiments.tipping import SAFE, Pendulum
from equipoise.platform.ramp import smooth_step
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.kinematics import Kinematics, foot_positions, inverse_kinematics
from equipoise.robot.model import DIAGONALS, LEG_NAMES
from equipoise.robot.posture import BodyPosture

UP = np.array([0.0, 0.0, 1.0])
LIFT, LOWER, DELAY = 0.03, 0.2, 0.05


@pytest.fixture(params=[*itertools.product(("a1", "skewed", "two_jointed"), DIAGONALS)], ids="-".join)
def case(request):
    """Robot, joint positions of a posture with the CoM off the line, and diagonal."""
    name, diagonal = request.param
    robot = request.getfixturevalue(name)
    stance = nominal_stance(robot)
    com = composite_parameters(robot, stance.joint_position).com
    feet = feet_in_posture(stance, com, BodyPosture(crouch=0.1), diagonal, 0.01)
    return robot, inverse_kinematics(robot, feet, stance.joint_position), diagonal


@pytest.fixture
def model(case):
    robot, position, diagonal = case
    return Pendulum.of(robot, position, UP, diagonal)


def test_a_robot_with_locked_joints_tips_at_the_rate_of_the_pendulum(case, model):
    """In simulation x grows exponentially; rolling feet slow it down by some percent."""
    robot, position, diagonal = case
    lift = pendulum(robot, position, diagonal, UP, rate=0.5 * model.lean * model.rate, duration=0.2)
    left = line_axes(robot, position, UP, diagonal)[0]
    speed = lift.angular_velocity_in_imu @ np.array(robot.imu_in_base.rotation).T @ left
    leaning = model.lean + np.cumsum(speed) * lift.step - (speed + speed[0]) / 2 * lift.step
    x = leaning + speed / model.rate
    np.testing.assert_allclose(x[-1] / x[0], np.exp(model.rate * 0.2), rtol=0.08)


def test_the_lean_is_linear_in_base_rotation_and_joints(case, model):
    """The reference is the CoM over the middle of the standing feet, in the world frame."""
    robot, position, diagonal = case
    generator = np.random.default_rng(1)
    _, normal, _ = line_axes(robot, position, UP, diagonal)
    standing = [leg in DIAGONALS[diagonal] for leg in LEG_NAMES]

    def ahead(turned, joints):
        com = Kinematics(robot).com(joints)
        middle = foot_positions(robot, joints)[standing].mean(axis=0)
        radius = robot.legs[DIAGONALS[diagonal][0]].foot_radius
        return normal @ (np.array(pin.exp3(turned)) @ (com - middle + radius * UP)) / model.height

    turned, moved = 1e-4 * generator.standard_normal(3), 1e-4 * generator.standard_normal(len(position))
    change = ahead(turned, position + moved) - ahead(np.zeros(3), position)
    assert change == pytest.approx(turned @ model.axis_in_base + moved @ model.joints, rel=1e-2, abs=1e-8)
    assert ahead(np.zeros(3), position) == pytest.approx(model.lean, abs=1e-9)


def test_the_room_ends_at_the_edge_of_the_feet(case, model):
    robot, position, diagonal = case
    left, normal, middle = line_axes(robot, position, UP, diagonal)
    places = np.column_stack([(foot_positions(robot, position) - middle) @ axis for axis in (left, normal)])
    hull = ConvexHull(places)

    def inside(ahead):
        return (hull.equations @ [model.along, ahead, 1] < 0).all()

    for sign, room in zip((-1, 1), model.room, strict=True):
        assert inside(0.99 * sign * room)
        assert not inside(1.01 * sign * room)
    lifted = places[[leg not in DIAGONALS[diagonal] for leg in LEG_NAMES]][:, 1]
    assert model.arm == pytest.approx((-lifted.min(), lifted.max()))


@pytest.mark.parametrize("side", [0, 1])
def test_a_stopped_robot_stays_within_the_safe_fraction_of_the_room(case, side):
    """The linear pendulum is integrated from rest to the stop, through the delay, and while the foot is lowered."""
    robot, position, diagonal = case
    model = Pendulum.of(robot, position, UP, diagonal)
    start, room, arm = 0.01, model.room[side], model.arm[side]
    lower = 0.8 * model.height * SAFE * room / arm / model.height  # so high that it does not land without a stop
    leaning = Pendulum(**{**vars(model), "lean": start if side else -start})
    height = max(LIFT, lower * arm)
    stop = leaning.stop(height, LOWER, DELAY)[side]
    assert np.isfinite(stop)

    def falls(_, state):
        return [state[1], model.rate**2 * state[0]]

    time = np.arange(0, 2, 1e-4)
    tipping_from_rest = solve_ivp(falls, (0, 2), [start, 0], t_eval=time, rtol=1e-9, atol=1e-12).y
    x = tipping_from_rest[0] + tipping_from_rest[1] / model.rate
    stopped = int(np.argmax(x >= stop))
    lowering = np.concatenate([np.zeros(round(DELAY / 1e-4)), smooth_step(round(LOWER / 1e-4)), np.ones(20000)])
    clearance = height * (1 - lowering[: len(time) - stopped]) - arm * (tipping_from_rest[0, stopped:] - start)
    landed = stopped + int(np.argmax(clearance <= 0))
    assert x[landed] * model.height == pytest.approx(SAFE * room, rel=0.12)


def test_the_uncertainty_of_the_com_is_a_margin(model):
    sure, unsure = model.stop(1.0, LOWER, DELAY), model.stop(1.0, LOWER, DELAY, 0.01)
    assert np.all(np.array(unsure) < np.array(sure) - 0.01 / model.height + 1e-9)


def test_a_low_lift_of_a_broad_robot_needs_no_stop(model):
    low = SAFE * min(model.room) / model.height * min(model.arm) / 4
    assert max(model.landing(low)) * model.height < SAFE * min(model.room)
    assert model.stop(low, LOWER, DELAY) == (np.inf, np.inf)
    assert max(model.stop(1.0, LOWER, DELAY)) < np.inf


def test_the_time_to_a_stop_is_that_of_the_pendulum(model):
    stop = (0.2, 0.3)
    time = model.time_until(stop)
    assert abs(model.lean) * np.exp(model.rate * time) == pytest.approx(stop[model.lean > 0])


# --- uncertainty of the CoM


def test_a_lift_of_the_search_determines_the_com_across_its_line(a1):
    stance = nominal_stance(a1)
    before, across = initial_covariance(stance), np.array([0.6, 0.8, 0.0])
    after = covariance_after_lift(stance, before, 3 * across)
    assert across @ after @ across == pytest.approx(across @ search_covariance(stance) @ across)
    along = np.array([0.8, -0.6, 0.0])
    assert along @ after @ along == pytest.approx(along @ before @ along)
    assert after[2, 2] == before[2, 2]


def test_after_both_diagonals_only_the_height_of_a_payload_is_uncertain(a1):
    stance = nominal_stance(a1)
    left, right = (covariance_after_lift(stance, np.zeros((3, 3)), np.array([0.6, y, 0.0])) for y in (0.8, -0.8))
    assert np.trace(left + right) < 2 * np.trace(search_covariance(stance))
    assert search_covariance(stance, 0.3)[2, 2] > 10 * search_covariance(stance)[2, 2]
    np.testing.assert_array_equal(search_covariance(stance, 0.3)[:2, :2], search_covariance(stance)[:2, :2])


# --- in simulation


@pytest.fixture
def narrow(tmp_path, monkeypatch):
    """Feet 0.14 m apart under hips 0.3 m high."""
    monkeypatch.setattr(robots, "HIPS", {leg: (x, 0.6 * y) for leg, (x, y) in robots.HIPS.items()})
    text = quadruped_urdf()
    for side in (0.08, -0.08):
        text = text.replace(f'xyz="0.0 {side} 0.0"', f'xyz="0.0 {side / 8} 0.0"')
    return load_text(tmp_path, text)


def tilt_after_a_lift(robot, share, monkeypatch):
    """Return the tilt [rad] of a robot with an unmodelled 30 % payload, 30 % softer drives and its CoM far off the line."""
    monkeypatch.setattr(tipping, "SAFE", share)
    monkeypatch.setattr(safe_lift, "_LEAST_UP", -np.inf)  # such a lift is not planned
    monkeypatch.setattr(lift_design, "_TILT_LIMIT", 0.3)
    monkeypatch.setattr(lift_design, "_OFFSET", 0.015)
    stance = nominal_stance(robot)
    with simulate(robot, "realistic", payload="4,0,0,0.15", seed=3) as simulation:
        simulation.errors.torque_gain[:] *= 0.7
        standing = StandingRobot(
            simulation.platform, robot, Target.standing(robot, stance.joint_position), stance.feet_in_base
        )
        trials = BayesianTrials(standing, stance, np.array(simulation.truth.composite.com))
        trials.com_covariance = search_covariance(stance)
        trials.lift(LiftDesign(BodyPosture(), "FL_RR", 1))
        standing.play(standing.motion().hold(1.0))
        return simulation.ground_truth().tilt


def test_a_narrow_robot_stays_on_its_feet_with_that_margin_and_not_with_twice_of_it(narrow, monkeypatch):
    assert narrow.mass < 4 / 0.28
    assert tilt_after_a_lift(narrow, SAFE, monkeypatch) < 0.1
    assert tilt_after_a_lift(narrow, 2 * SAFE, monkeypatch) > 1.0


@pytest.fixture
def soft_trials(a1):
    """Trials on a realistic A1 with drives 30 % softer than its model and a known CoM, and their recordings."""
    stance = nominal_stance(a1)
    with simulate(a1, "realistic", seed=1) as simulation:
        simulation.errors.torque_gain[:] *= 0.7
        standing = StandingRobot(
            simulation.platform, a1, Target.standing(a1, stance.joint_position), stance.feet_in_base
        )
        recordings = []
        standing.keep = recordings.append
        trials = BayesianTrials(standing, stance, np.array(simulation.truth.composite.com))
        trials.com_covariance = search_covariance(stance)
        yield trials, recordings


LEANING = BodyPosture(roll=0.22, pitch=-0.22, crouch=0.12)


def aim_error(trials, recording, design):
    """Return the distance of the CoM from its designed position, from the rest before the lift [m]."""
    tipping = tipping_from(trials.standing, recording.phase("rest"), design.diagonal)
    return tipping.ahead + offset_of(trials.stance, design.side)


@pytest.mark.parametrize("aimed", [True, False])
def test_the_com_is_at_its_designed_position_on_soft_legs(soft_trials, aimed, monkeypatch):
    trials, _ = soft_trials
    if not aimed:
        monkeypatch.setattr(BayesianTrials, "_drift_of", lambda *_: np.zeros(2))
    trials.take_posture(LEANING)
    design = LiftDesign(LEANING, "FR_RL", 1)
    assert (abs(aim_error(trials, trials.lift(design), design)) < 5e-3) == aimed


def test_a_lift_that_could_tip_the_robot_over_is_rejected(soft_trials):
    trials, recordings = soft_trials
    trials.com_covariance = search_covariance(trials.stance, 0.7)
    trials.take_posture(LEANING)
    with pytest.raises(
        ReachError, match=r"the robot could tip over: its centre of mass is \d+ mm from the support line, uncertain by"
    ):
        trials.lift(LiftDesign(LEANING, "FR_RL", 1))
    assert not recordings[-1].has_phase("unload")
    left_out = read_motions(trials.standing.robot, trials.stance, recordings)[-1].left_out
    assert left_out == "not lifted: out of reach, or the robot could have tipped over"
    trials.take_posture(BodyPosture())
    assert trials.lift(LiftDesign(BodyPosture(), "FR_RL", 1)).has_phase("lower")


def test_a_plan_excludes_lifts_that_could_tip_the_robot_over(narrow):
    """No lift is possible if the CoM is uncertain by 5 cm."""
    stance = nominal_stance(narrow)
    com = composite_parameters(narrow, stance.joint_position).com
    for side in (1, -1):
        design = LiftDesign(BodyPosture(), "FL_RR", side)
        LiftChecks(narrow, stance, com).check(design)
        with pytest.raises(ReachError, match="the robot could tip over"):
            LiftChecks(narrow, stance, com, np.diag([0.05, 0.05, 0.05]) ** 2).check(design)


class EnoughError(Exception):
    """Raised after a number of motions."""


@pytest.mark.parametrize(("name", "seed", "motions"), [("laikago", 1, 20), ("mini_cheetah", 1, 25)])
def test_robots_that_were_thrown_on_their_backs_stay_up(name, seed, motions):
    """They fell in a lift in a posture leaning by 18 degrees, up to the 22nd motion of `equipoise calibrate`."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            robot = load_robot(name)
    except MissingDependencyError as error:
        pytest.skip(str(error))
    tilts = []
    with simulate(robot, "realistic", seed=seed) as simulation:

        def keep(recording):
            tilts.append(simulation.ground_truth().tilt)
            if len(tilts) == motions:
                raise EnoughError

        with pytest.raises(EnoughError):
            calibrate(simulation.platform, robot, BayesianMethod(), keep)
    assert max(tilts) < 0.4
