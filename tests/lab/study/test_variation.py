"""Random robots: varied lengths and masses, equal in both engines."""

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from robots import load_text, quadruped_mjcf, quadruped_urdf

from equipoise import EffectSizes, Payload, nominal_stance, simulate
from equipoise.errors import SettingsError
from equipoise.lab.study.variation import LARGEST_SPREAD, SegmentVariation, vary, with_segments
from equipoise.robot.inertial import composite_parameters
from equipoise.robot.kinematics import foot_positions
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.mujoco_model import build_simulated_robot

SAME = SegmentVariation(1.0, 1.0)
FORMATS = ["urdf", "mjcf", "a1", "two_jointed", "skewed"]


@pytest.fixture(scope="module")
def urdf(tmp_path_factory):
    return load_text(tmp_path_factory.mktemp("urdf"), quadruped_urdf())


@pytest.fixture(scope="module")
def mjcf(tmp_path_factory):
    return load_text(tmp_path_factory.mktemp("mjcf"), quadruped_mjcf())


@pytest.fixture(scope="module", params=FORMATS)
def robot(request):
    return request.getfixturevalue(request.param)


def simulated(robot, payload=None):
    stance = nominal_stance(robot)
    errors = DrawnErrors.draw(EffectSizes(), len(robot.joint_names), 0)
    return build_simulated_robot(robot, stance, errors, payload, 1e-3), stance


def test_a_spread_of_zero_gives_the_same_robot(robot):
    same = vary(robot, 0.0, np.random.default_rng(1))
    assert same.mass == pytest.approx(robot.mass, rel=1e-12)
    assert same.leg_length == pytest.approx(robot.leg_length, rel=1e-12)
    stance = nominal_stance(robot)
    assert np.allclose(nominal_stance(same).joint_position, stance.joint_position, atol=1e-9)
    one, other = (composite_parameters(each, stance.joint_position) for each in (robot, same))
    assert np.allclose(one.com, other.com, atol=1e-12)
    assert np.allclose(one.inertia, other.inertia, atol=1e-12)


def test_a_spread_changes_lengths_and_masses(robot):
    others = [vary(robot, 0.1, np.random.default_rng(seed)) for seed in range(8)]
    for name in ("mass", "leg_length"):
        ratios = np.array([getattr(other, name) for other in others]) / getattr(robot, name)
        assert np.unique(ratios).size == len(others)
        assert (np.abs(np.log(ratios)) <= 0.2 + 1e-9).all()  # truncated at two standard deviations
    assert others[0].joint_names == robot.joint_names
    assert len({other.source.sha256 for other in others} | {robot.source.sha256}) == 9


def test_the_same_generator_gives_the_same_robot(a1):
    one, other = (vary(a1, 0.2, np.random.default_rng(4)) for _ in range(2))
    assert one.source == other.source


@pytest.mark.parametrize("seed", range(3))
def test_both_engines_have_the_same_random_robot(robot, seed):
    other = vary(robot, 0.15, np.random.default_rng(seed))
    payload = Payload.parse("0.7,0.05,0.01,0.06")
    built, stance = simulated(other, payload)
    assert built.model.body_mass.sum() == pytest.approx(pin.computeTotalMass(other.pinocchio) + 0.7, rel=1e-9)
    data = mujoco.MjData(built.model)
    data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
    data.qpos[built.qpos] = stance.joint_position
    mujoco.mj_kinematics(built.model, data)
    feet = [data.geom(f"equipoise_{leg}_foot").xpos for leg in other.legs]
    assert np.allclose(feet, foot_positions(other, stance.joint_position), atol=1e-9)


def test_the_truth_of_a_random_robot_is_its_model_and_the_payload(a1):
    other = vary(a1, 0.2, np.random.default_rng(0))
    with simulate(other, "ideal", payload="1,0.1,0,0.05") as simulation:
        truth = simulation.truth.composite
    model = composite_parameters(other, nominal_stance(other).joint_position)
    assert truth.mass == pytest.approx(model.mass + 1, rel=1e-9)
    together = (model.mass * model.com + [0.1, 0, 0.05]) / (model.mass + 1)
    assert np.allclose(truth.com, together, atol=1e-9)


def test_random_robots_can_stand(robot):
    for seed in range(10):
        for spread in (0.1, LARGEST_SPREAD):
            other = vary(robot, spread, np.random.default_rng(seed))
            stance = nominal_stance(other)
            assert np.allclose(foot_positions(other, stance.joint_position), stance.feet_in_base, atol=1e-6)
            assert np.ptp(stance.feet_in_base[:, 2]) < 1e-6


@pytest.mark.parametrize("name", ["urdf", "mjcf"])
def test_segments_scale_lengths_and_masses(name, request):
    robot = request.getfixturevalue(name)
    hips, thighs, shanks = (0.7, 1.0, 0.2)  # [kg], of each leg
    segments = [SegmentVariation(1.0, 2.0), SegmentVariation(1.5, 3.0), SegmentVariation(0.5, 4.0)]
    other = with_segments(robot, SegmentVariation(1.25, 1.5), segments)
    assert robot.leg_length == pytest.approx(0.2 + 0.2)
    assert other.leg_length == pytest.approx(1.5 * 0.2 + 0.5 * 0.2)
    assert robot.mass == pytest.approx(6 + 4 * (hips + thighs + shanks))
    assert other.mass == pytest.approx(1.5 * 6 + 4 * (2 * hips + 3 * thighs + 4 * shanks))
    # The trunk's own inertial: its CoM goes with the length, its moments with mass and length squared.
    before, after = (each.pinocchio.inertias[1] for each in (robot, other))
    assert np.allclose(after.lever, 1.25 * before.lever)
    assert np.allclose(after.inertia, 1.5 * 1.25**2 * before.inertia)
    hip = {each: each.pinocchio.jointPlacements[each.legs["FL"].joint_ids[0]].translation for each in (robot, other)}
    assert np.allclose(hip[other], 1.25 * hip[robot])


@pytest.mark.parametrize("name", ["urdf", "mjcf"])
def test_the_trunks_com_is_shifted(name, request):
    robot = request.getfixturevalue(name)
    other = with_segments(robot, SegmentVariation(1.0, 1.0, (0.03, -0.02, 0.01)), [SAME] * 3)
    assert np.allclose(other.pinocchio.inertias[1].lever - robot.pinocchio.inertias[1].lever, [0.03, -0.02, 0.01])
    assert other.mass == pytest.approx(robot.mass)


@pytest.mark.parametrize("spread", [-0.01, 0.31, float("nan")])
def test_spreads_out_of_range_raise_an_error(a1, spread):
    with pytest.raises(SettingsError, match=f"{spread:g}; it must be from 0 to 0.3"):
        vary(a1, spread, np.random.default_rng(0))
