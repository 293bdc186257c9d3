"""Errors added to the recordings of a realistic run: they are estimated, and the body does not change."""

import functools
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.signal import savgol_filter

from equipoise import BayesianMethod, load_robot
from equipoise.estimator.diagnostics import prior_conflict
from equipoise.estimator.motions import read_motions
from equipoise.estimator.problem import estimate_posterior
from equipoise.estimator.unknowns import Priors
from equipoise.robot.description import RobotDescription
from equipoise.robot.inertial import components

GYRO = ("gyro_gain", "gyro_misalignment")
LENGTHS = ("link_length", "link_length_common")


OTHERS = (
    "leg_mass_common", "link_com", "link_com_common", "compliance", "backlash", "accelerometer_gain", *GYRO,
    "rolling_resistance",
    "foot_radius_each", "foot_compliance", *LENGTHS, "hip_position", "external_force", "torque_gain_common", "rotor_spin",
    "eccentricity",
    "accelerometer_drift", "gyro_drift", "imu_position",
)  # fmt: skip


def estimating(*names):
    """Return priors that fix all OTHERS except these names."""
    return Priors().holding(*(name for name in OTHERS if name not in names))


def posterior_of(a1, run, recordings, combined_priors):
    evidence = read_motions(a1, run.stance, recordings)
    return estimate_posterior(a1, run.stance, evidence, combined_priors, (run.truth.composite.mass, 0.06))


@pytest.fixture(scope="module")
def plain_posterior(a1, bayesian_run):
    """Return a function of priors that estimates from the unchanged recordings, once for each."""
    return functools.cache(lambda priors: posterior_of(a1, bayesian_run, bayesian_run.recordings, priors))


@pytest.fixture(scope="module")
def plain_result(a1, bayesian_run):
    """Return the method's result for the unchanged recordings."""
    return estimated(a1, bayesian_run)


def moved(found, plain):
    """Return the change of the body's ten parameters, in reported standard deviations."""
    return (components(found.robot_body) - components(plain.robot_body)) / np.sqrt(np.diag(found.robot_covariance))


def gained(found, plain, name):
    """Return the change of the estimate of a row."""
    return found.unknowns.value(found.x, name) - plain.unknowns.value(plain.x, name)


def with_gyroscope(recordings, error):
    """Return recordings of which (1 - error) is the true angular velocity."""
    read = np.linalg.inv(np.eye(3) - error)

    def seen(recording):
        imu = recording.imu
        return replace(recording, imu=replace(imu, angular_velocity_in_imu=imu.angular_velocity_in_imu @ read.T))

    return [seen(recording) for recording in recordings]


@pytest.mark.parametrize("combined_priors", [estimating(*GYRO), Priors()], ids=["all others fixed", "usual priors"])
def test_gains_and_misalignment_of_the_gyroscope(a1, bayesian_run, plain_posterior, combined_priors):
    gains, misalignment = np.array([0.012, -0.01, 0.008]), np.array([6e-3, -4e-3, -7e-3, 5e-3, 3e-3, -6e-3])
    error = np.diag(gains)
    error[~np.eye(3, dtype=bool)] = misalignment
    recordings = with_gyroscope(bayesian_run.recordings, error)
    plain = plain_posterior(combined_priors)
    found = posterior_of(a1, bayesian_run, recordings, combined_priors)
    for name, true in (("gyro_gain", gains), ("gyro_misalignment", misalignment)):
        off = (gained(found, plain, name) - true) / found.std(name)
        assert np.abs(off).max() < 1.5, name
    assert (found.std("gyro_gain") < (0.65 if combined_priors != Priors() else 0.7) * 0.01).all()
    assert np.abs(moved(found, plain)).max() < 1
    # Lifts integrate no attitude: it takes worse axes to shift the body.
    worse = with_gyroscope(bayesian_run.recordings, 3 * error)
    held = posterior_of(a1, bayesian_run, worse, combined_priors.holding(*GYRO))
    assert np.abs(moved(held, plain)).max() > 2


def with_drive_train(recordings, give, play):
    """Encoders on motors: springs and hard play lie between them and the links that the recordings are of."""

    def seen(recording):
        joints = recording.joints
        acting = savgol_filter(joints.torque, 31, 3, axis=0)  # noise of the torque sensors bends no gear
        rate = np.gradient(acting, joints.time, axis=0)
        position = joints.position + np.tile(give, 4) * acting + np.tile(play, 4) / 2 * np.sign(acting)
        return replace(
            recording,
            joints=replace(joints, position=position, velocity=joints.velocity + np.tile(give, 4) * rate),
        )

    return [seen(recording) for recording in recordings]


@pytest.mark.parametrize(
    ("combined_priors", "reduction"),
    [(estimating("compliance"), 0.85), (Priors(), 0.95)],
    ids=["all others fixed", "usual priors"],
)
def test_springs_of_the_drive_train(a1, bayesian_run, plain_posterior, combined_priors, reduction):
    """An A1 has the same joints in every leg: hip, thigh and calf. Undetermined compliance does not change the body."""
    give = np.array([1 / 2500, 1 / 4000, 1 / 3000])
    recordings = with_drive_train(bayesian_run.recordings, give, np.zeros(3))
    plain = plain_posterior(combined_priors)
    found = posterior_of(a1, bayesian_run, recordings, combined_priors)
    assert np.abs((gained(found, plain, "compliance") - give) / found.std("compliance")).max() < 1.5
    prior = found.unknowns.scale[found.unknowns["compliance"]]
    assert (found.std("compliance") < reduction * prior).all()
    assert np.abs(moved(found, plain)).max() < 0.7
    held = posterior_of(a1, bayesian_run, recordings, combined_priors.holding("compliance"))
    assert np.abs(moved(held, plain)).max() < 0.7


@pytest.mark.parametrize(
    "combined_priors", [estimating("compliance", "backlash"), Priors()], ids=["all others fixed", "usual priors"]
)
def test_backlash_of_the_drive_train(a1, bayesian_run, plain_posterior, combined_priors):
    """Backlash reverses abruptly at zero torque, but smoothly in the model: products of inertia are less accurate."""
    play = np.array([2e-3, 2e-3, 0.0])
    recordings = with_drive_train(bayesian_run.recordings, np.zeros(3), play)
    plain = plain_posterior(combined_priors)
    found = posterior_of(a1, bayesian_run, recordings, combined_priors)
    off = (gained(found, plain, "backlash") - play)[:2]
    assert np.abs(off / found.std("backlash")[:2]).max() < 1.5
    assert (found.std("backlash")[:2] < 1.9e-3).all()
    assert abs(off[1]) < 1.3e-3  # thighs turn over most
    assert np.abs(moved(found, plain)[:7]).max() < 1


def another_model(a1):
    """Return a copy of an A1 whose Pinocchio model can be changed."""
    return a1.with_base(a1.pinocchio.inertias[1])


def off(found, run):
    """Return the errors of mass, CoM and principal moments, in reported standard deviations."""
    error = components(found.robot_body) - components(run.truth.composite)
    return (error / np.sqrt(np.diag(found.robot_covariance)))[:7]


# The recordings stay, and the model is changed: the robot is the same, and its estimate must be within the intervals.


def test_legs_that_are_heavier_and_lower_than_in_the_model(a1, bayesian_run, plain_posterior):
    model, recordings = another_model(a1), bayesian_run.recordings
    for leg in model.legs.values():
        for joint in leg.joint_ids:
            link = model.pinocchio.inertias[joint]
            lever = np.array(link.lever) + (0.0 if joint == leg.joint_ids[0] else np.array([0.0, 0.0, 5e-3]))
            model.pinocchio.inertias[joint] = pin.Inertia(link.mass / 1.1, lever, link.inertia / 1.1)
    plain, found = plain_posterior(Priors()), posterior_of(model, bayesian_run, recordings, Priors())
    assert np.abs(moved(found, plain)).max() < 1
    assert np.abs(off(found, bayesian_run)).max() < 3
    trusting = BayesianMethod(leg_prior="narrow").combined_priors
    plain, held = plain_posterior(trusting), posterior_of(model, bayesian_run, recordings, trusting)
    assert np.abs(moved(held, plain)).max() > 2.4
    assert np.abs(off(held, bayesian_run)).max() > 2


@pytest.mark.parametrize(
    "combined_priors", [estimating("imu_position"), Priors()], ids=["all others fixed", "usual priors"]
)
def test_an_imu_with_a_position_error_in_the_model(a1, bayesian_run, plain_posterior, combined_priors):
    offset = np.array([3e-3, -3e-3, 2e-3])
    model, recordings = load_robot("unitree_a1", RobotDescription(imu_position=tuple(offset))), bayesian_run.recordings
    plain, found = plain_posterior(combined_priors), posterior_of(model, bayesian_run, recordings, combined_priors)
    missed = gained(found, plain, "imu_position") + offset
    assert np.abs(missed / found.std("imu_position")).max() < 1.5
    assert np.abs(moved(found, plain)).max() < 1.2
    assert np.abs(off(found, bayesian_run)).max() < 2.5
    held = posterior_of(model, bayesian_run, recordings, combined_priors.holding("imu_position"))
    assert np.abs(moved(held, plain)).max() > 1.4


def with_longer_legs(robot, longer):
    """Return a model with longer thighs and calves [m]."""
    model = another_model(robot)
    for leg in model.legs.values():
        calf, foot = model.pinocchio.jointPlacements[leg.joint_ids[-1]], model.pinocchio.frames[leg.foot_frame_id]
        placement = foot.placement
        for part in (calf, placement):
            part.translation = part.translation * (1 + longer / np.linalg.norm(part.translation))
        foot.placement = placement
    return model


def test_legs_that_are_shorter_than_in_the_model(a1, bayesian_run, plain_posterior):
    model, recordings = with_longer_legs(a1, 2e-3), bayesian_run.recordings
    for combined_priors in (estimating(*LENGTHS), Priors()):
        plain, found = plain_posterior(combined_priors), posterior_of(model, bayesian_run, recordings, combined_priors)
        longer = gained(found, plain, "link_length_common") + [
            part.mean() for part in gained(found, plain, "link_length").reshape(4, 2).T
        ]
        np.testing.assert_allclose(longer, -2e-3, atol=1.4e-3)
        assert np.abs(off(found, bayesian_run)).max() < 2.5
    assert np.abs(moved(found, plain)).max() < 0.7


def estimated(model, run, combined_priors=None):
    """Return the estimate of the method, which tests for prior conflicts."""
    mass = run.truth.composite.mass
    return BayesianMethod(mass=mass, mass_std=0.06, priors=combined_priors or Priors()).estimate(
        model, run.recordings, run.stance
    )


def test_a_conflicting_imu_position_is_estimated_with_a_wide_prior(bayesian_run, plain_result):
    """With the usual prior, 30 mm are split between position and inertia, and all residuals are small."""
    offset = np.array([0.02, -0.01, 0.03])
    model = load_robot("unitree_a1", RobotDescription(imu_position=tuple(offset)))
    plain, found = plain_result, estimated(model, bayesian_run)
    place = [next(one for one in found.sensors if one.name == f"IMU position {axis}") for axis in "xyz"]
    assert all(abs(one.value + off) < 3 * one.std for one, off in zip(place, offset, strict=True))
    assert max(one.std for one in place) < 1.2e-2
    assert found.assumptions[2:] == (
        "the run contradicts the model file: the position of the IMU differs from the file",
    )
    assert not any("contradicts" in one for one in plain.assumptions)
    apart = (found.composite.values - plain.composite.values) / found.composite.stds
    assert np.abs(apart).max() < 1.5
    given = estimated(model, bayesian_run, Priors(imu_position=2.1e-3))  # a prior that the user gives is not tested
    assert not any("contradicts" in one for one in given.assumptions)
    wrong = (given.composite.values - plain.composite.values) / given.composite.stds
    assert np.abs(wrong).max() > 4


def test_an_imu_position_hidden_by_its_prior_is_found(bayesian_run, monkeypatch):
    """With the usual prior, residuals raise the noise levels, which makes the position plausible."""
    model = load_robot("unitree_a1", RobotDescription(imu_position=(0.0, 0.0, 0.027)))
    found = estimated(model, bayesian_run)
    assert found.assumptions[2:] == (
        "the run contradicts the model file: the position of the IMU differs from the file",
    )
    assert np.abs(off(found.evidence.posterior, bayesian_run)).max() < 2.5
    monkeypatch.setattr(prior_conflict, "_SUSPECTED", prior_conflict._CONTRADICTED)
    unseen = estimated(model, bayesian_run)  # likely enough at the usual prior
    assumed = unseen.assumptions[2:]  # behind the given mass and the cable
    assert [one.split(":")[0] for one in assumed] == [
        "the height of the IMU in the model file is right within 2 mm (standard deviation)"
    ]
    off_by_a_centimetre = float(assumed[0].removesuffix("%").rsplit(maxsplit=1)[-1]) / 100
    share = unseen.composite.values[4] / found.composite.values[4] - 1
    np.testing.assert_allclose(abs(share), 2.7 * off_by_a_centimetre, rtol=0.3)


def test_a_body_is_composed_with_the_estimated_hip_positions(a1, bayesian_run, plain_result):
    """Hips are off by 10 mm each way: with the file's positions Iyy and Izz would be 3 and 4 % too large."""
    model = another_model(a1)
    for leg in model.legs.values():
        place = model.pinocchio.jointPlacements[leg.joint_ids[0]]
        place.translation = place.translation + 0.01 * np.sign(place.translation) * [1, 0, 0]
    found, right = estimated(model, bayesian_run), plain_result
    assert "the run contradicts the model file: hip positions differ from the file" in found.assumptions
    apart = found.composite.values / right.composite.values - 1
    assert np.abs(apart[4:7]).max() < 0.015
    assert np.abs(off(found.evidence.posterior, bayesian_run)).max() < 2.5


def test_legs_of_another_length_are_estimated_with_wide_priors(a1, bayesian_run):
    """Thighs and calves are 15 mm longer than in the file."""
    found = estimated(with_longer_legs(a1, 15e-3), bayesian_run)
    lengths = [
        next(one for one in found.sensors if one.name == f"length of the {kind}") for kind in ("thighs", "calves")
    ]
    assert all(abs(one.value + 15e-3) < 4e-3 for one in lengths)
    assert any("in all legs alike" in assumption for assumption in found.assumptions)
    error = found.composite.values - components(bayesian_run.truth.composite)
    assert np.abs(error / found.composite.stds).max() < 3
