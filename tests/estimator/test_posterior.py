"""Posterior from a short run of a realistic simulated robot."""

from dataclasses import replace

import numpy as np
import pytest
from tilting import moving_robot

from equipoise import nominal_stance
from equipoise.errors import RecordingError
from equipoise.estimator.diagnostics.sensor_findings import sensor_findings
from equipoise.estimator.equations.stance_motion import StanceMotion, StanceMotions
from equipoise.estimator.equations.tilt import TiltEquation, TiltNoise
from equipoise.estimator.equations.torque_balance import TorqueBalance, TorqueSamples
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.measurements.lift_samples import LiftSamples
from equipoise.estimator.measurements.tilt_invariant import TiltInvariant
from equipoise.estimator.motions import read_motions
from equipoise.estimator.parameters import Unknowns
from equipoise.estimator.problem import MapProblem, body_jacobian, estimate_posterior, prior_rows
from equipoise.estimator.unknowns import Priors
from equipoise.recording.recording import JointStream
from equipoise.robot.inertial import COMPONENTS, components
from equipoise.simulation.drawn_errors import DrawnErrors
from equipoise.simulation.effects import PRESETS

READINGS = {
    "velocity_noise": "joint_velocity",
    "angular_velocity_noise": "angular_velocity_in_imu",
    "acceleration_noise": "acceleration_in_imu",
}
SURE = 5.0  # standard deviations: a fixed seed of a test that may fail once in a million


@pytest.fixture(scope="module")
def evidence(a1, bayesian_run):
    return read_motions(a1, bayesian_run.stance, bayesian_run.recordings)


@pytest.fixture(scope="module")
def posterior(a1, bayesian_run, evidence):
    return estimate_posterior(a1, bayesian_run.stance, evidence)


@pytest.fixture(scope="module")
def drawn(a1, bayesian_run):
    """Return the errors of the simulated robot."""
    sizes = PRESETS["realistic"].scaled_to(bayesian_run.stance.scale)
    return DrawnErrors.draw(sizes, 12, bayesian_run.seed)


def lifts_of(evidence):
    return [motion.lift for motion in evidence if motion.lift is not None]


def blocks_of(unknowns, evidence):
    kinds = {"tilt": TiltEquation, "stance": StanceMotions, "torque": TorqueBalance}
    return {name: kind.of(unknowns, evidence) for name, kind in kinds.items()}


def with_samples(motion, kind, *samples):
    """Return a motion with other samples of one kind."""
    return replace(motion, samples=(*(one for one in motion.samples if not isinstance(one, kind)), *samples))


# --- derivatives


@pytest.fixture(scope="module")
def blocks(a1, posterior, evidence):
    return blocks_of(posterior.unknowns, evidence)


@pytest.fixture(scope="module")
def steady_blocks(a1, posterior, evidence):
    """Return blocks whose noise does not depend on the parameters: their factors in the tilt equation are zero."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("equipoise.estimator.equations.tilt._BIAS_FLOOR", 0.0)
        motions = [
            motion if motion.lift is None else with_samples(motion, LiftSamples, without_noise(motion.lift))
            for motion in evidence
        ]
        unknowns = posterior.problem.with_all_open(posterior.x)[0].unknowns
        return blocks_of(unknowns, tuple(motions))


def without_noise(lift):
    return replace(lift, **{name: np.zeros_like(getattr(lift, name)) for name in READINGS})


def away_from(posterior):
    """Return a vector at which residuals are not small."""
    std = np.sqrt(np.diag(posterior.covariance))
    return posterior.x + np.random.default_rng(1).standard_normal(posterior.unknowns.size) * std


@pytest.mark.parametrize("name", ["tilt", "stance", "torque"])
def test_derivatives_are_central_differences_by_every_parameter(steady_blocks, posterior, name):
    block = steady_blocks[name]
    unknowns = block.unknowns
    _, x, _ = posterior.problem.with_all_open(away_from(posterior))
    x[x == 0] = 0.5
    block.prepare(x)
    residual, jacobian = block.linearise(x)
    np.testing.assert_allclose(residual, block.residual(x), rtol=1e-9, atol=1e-9)
    whole = np.zeros((len(residual), unknowns.size))  # of what the block does not depend on, columns of zeros
    whole[:, block.columns] = jacobian
    for column, unit in enumerate(1e-4 * np.eye(unknowns.size)):
        difference = (block.residual(x + unit) - block.residual(x - unit)) / 2e-4
        close = 1e-6 * np.abs(difference).max() + 1e-7
        np.testing.assert_allclose(whole[:, column], difference, atol=close, err_msg=str(column))


@pytest.mark.parametrize("worst", [2.0, 20.0])
def test_noise_that_depends_on_the_parameters_is_in_the_gradient(a1, posterior, evidence, worst):
    """Compare with differences of half the squared residual; the noise is raised to dominate the derivative."""
    unknowns, x = posterior.unknowns, away_from(posterior)
    lifts = [replace(lift, **{name: 30 * getattr(lift, name) for name in READINGS}) for lift in lifts_of(evidence)]
    block = TiltEquation(unknowns, list(enumerate(lifts)))
    block.scale = np.linspace(1.0, worst, len(lifts))
    block.prepare(x)

    def half_square(x):
        residual = block.residual(x)
        return residual @ residual / 2

    gradient = sum(part for _, _, part in block.by_motion(x))
    differences = [(half_square(x + unit) - half_square(x - unit)) / 2e-4 for unit in 1e-4 * np.eye(unknowns.size)]
    np.testing.assert_allclose(gradient, differences, rtol=1e-4, atol=1e-6 * np.abs(differences).max())


@pytest.mark.parametrize("mass", [None, (13.0, 0.1)])
def test_prior_residuals_and_their_jacobian_match_differences(posterior, mass):
    unknowns, x = posterior.unknowns, posterior.x
    _, jacobian = prior_rows(unknowns, x, mass)
    for column, unit in enumerate(1e-6 * np.eye(unknowns.size)):
        ahead, behind = (prior_rows(unknowns, x + sign * unit, mass)[0] for sign in (1, -1))
        np.testing.assert_allclose(jacobian[:, column], (ahead - behind) / 2e-6, rtol=1e-5, atol=1e-6)
    residual, _ = prior_rows(unknowns, unknowns.start(), mass)
    assert np.count_nonzero(np.abs(residual) > 1e-9) == (mass is not None)


def test_bodies_jacobians_are_those_of_larger_differences(posterior):
    unknowns, x = posterior.unknowns, posterior.x
    jacobian = body_jacobian(unknowns, x, unknowns.robot_body)
    direction = np.random.default_rng(2).standard_normal(unknowns.size)
    ahead, behind = (components(unknowns.robot_body(x + sign * 1e-3 * direction)) for sign in (1, -1))
    np.testing.assert_allclose(jacobian @ direction, (ahead - behind) / 2e-3, rtol=1e-3, atol=1e-5)
    assert not jacobian[:, unknowns["joint_offset"].start :].any()


def test_a_long_motions_torques_compress_to_few_rows(a1, posterior, bayesian_run, monkeypatch):
    """Information, gradients and noise by motion equal those of all rows, for any number of samples per block."""
    monkeypatch.setattr("equipoise.estimator.equations.torque_balance._STEP", 0.02)  # more rows than unknowns
    evidence = read_motions(a1, bayesian_run.stance, bayesian_run.recordings)

    def equations_at(x):
        block = blocks_of(posterior.unknowns, evidence)["torque"]
        block.prepare(x)
        before = list(block.by_motion(x))
        block.renew_noise(x + 0.5)
        return before, block.normalized_residual, len(block.residual(x))

    few, noise, count = equations_at(posterior.x)
    monkeypatch.setattr("equipoise.estimator.equations.torque_balance._SAMPLES_AT_ONCE", 50)
    pieces, same_noise, _ = equations_at(posterior.x)
    monkeypatch.setattr("equipoise.estimator.equations.torque_balance._few_rows", lambda system: system)
    many, all_noise, all_rows = equations_at(posterior.x)
    assert count < all_rows
    assert noise == pytest.approx(all_noise, rel=1e-9) == pytest.approx(same_noise, rel=1e-9)
    for one in (few, pieces):
        for (motion, information, gradient), (other, expected, slope) in zip(one, many, strict=True):
            assert motion == other
            np.testing.assert_allclose(information, expected, atol=1e-9 * np.abs(expected).max())
            np.testing.assert_allclose(gradient, slope, atol=1e-8 * np.abs(slope).max())


# --- the torques of a robot whose motors and friction are known


def test_true_gains_friction_and_armature_leave_no_torque(a1):
    """Test the signs and units of all torque parameters in one balance."""
    generator, unknowns = np.random.default_rng(3), Unknowns(a1, nominal_stance(a1), Priors())
    samples = moving_robot(a1, 5)
    x = unknowns.start()
    for name in ("torque_gain", "coulomb_friction", "viscous_friction", "armature"):
        x[unknowns[name]] = generator.uniform(0.3, 1.5, len(x[unknowns[name]]))
    value = {
        name: unknowns.value(x, name) for name in ("torque_gain", "coulomb_friction", "viscous_friction", "armature")
    }
    lost = value["coulomb_friction"] * np.tanh(samples.joint_velocity / 0.03)
    lost += value["viscous_friction"] * samples.joint_velocity + value["armature"] * samples.joint_acceleration
    reported = (samples.joint_torque + lost) / (1 + value["torque_gain"])
    block = TorqueBalance(unknowns, [(0, replace(samples, joint_torque=reported))])
    block.prepare(x)
    assert np.abs(block.residual(x)).max() < 1e-8
    for name in value:
        other = x.copy()
        other[unknowns[name]] = 0
        assert np.abs(block.residual(other)).max() > 1e-3


def test_rows_of_several_motions_belong_to_their_motions(a1):
    few = Priors().holding("leg_mass_common", "link_com", "link_com_common")  # fewer than rows
    unknowns = Unknowns(a1, nominal_stance(a1), few)
    block = TorqueBalance(unknowns, [(4, moving_robot(a1, 5)), (7, moving_robot(a1, 6)), (7, moving_robot(a1, 7))])
    block.prepare(unknowns.start())
    (first, rows), (second, others) = block.motions
    assert (first, rows, second, others.start) == (4, slice(0, 24), 7, 24)
    assert others.stop == len(block.residual(unknowns.start())) < 72  # as many as there are columns say the same


# --- the estimate against the truth


def step_left(posterior):
    """Return the largest component of the next Gauss-Newton step, in standard deviations."""
    residual, rows = prior_rows(posterior.unknowns, posterior.x, None)
    gradient = rows.T @ residual + sum(posterior.gradient.values())
    return np.abs(posterior.covariance @ gradient / np.sqrt(np.diag(posterior.covariance))).max()


@pytest.mark.parametrize("body", ["composite", "base", "stance_effective"])
def test_the_errors_are_within_the_intervals(bayesian_run, body):
    truth = components(getattr(bayesian_run.truth, body))
    found = getattr(bayesian_run.result, body)
    off = (found.values - truth) / found.stds
    assert np.abs(off).max() < SURE, dict(zip(COMPONENTS, off, strict=True))


def test_the_estimate_is_good(bayesian_run):
    off = components(bayesian_run.result.composite.parameters()) - components(bayesian_run.truth.composite)
    assert np.abs(off[1:3]).max() < 2e-3
    assert abs(off[3]) < 5e-3
    assert abs(off[0]) < 0.1 * bayesian_run.truth.composite.mass  # without a scale


def test_sensors_are_calibrated_on_the_way(posterior, drawn, bayesian_run):
    truths = {
        "joint_offset": drawn.drawn["joint_offset"],
        "imu_tilt": drawn.drawn["imu_tilt"],
        "accelerometer_bias": drawn.drawn["accelerometer_bias"],
        "clock_offset": np.array([0.5e-3]),
        "leg_mass": drawn.leg_mass_scale - 1,
        "torque_gain": drawn.torque_gain - 1,
    }
    for name, truth in truths.items():
        found, std = posterior.unknowns.value(posterior.x, name), posterior.std(name)
        if name not in {"leg_mass", "torque_gain"}:
            assert np.abs((found - truth) / std).max() < SURE, name
        prior = posterior.unknowns.scale[posterior.unknowns[name]]
        assert (std <= prior * (1 + 1e-9)).all(), name
    found = posterior.unknowns.value(posterior.x, "joint_offset")
    assert np.linalg.norm(found - drawn.drawn["joint_offset"]) < 0.9 * np.linalg.norm(drawn.drawn["joint_offset"])


def test_every_body_is_physically_consistent(posterior):
    unknowns = posterior.unknowns
    for body in (unknowns.base_body, unknowns.robot_body, unknowns.stance_effective_body):
        assert body(posterior.x).physical_defect() is None


def test_the_estimate_has_converged_and_its_covariance_is_the_informations_inverse(posterior):
    _, rows = prior_rows(posterior.unknowns, posterior.x, None)
    information = rows.T @ rows + sum(posterior.information.values())
    np.testing.assert_allclose(posterior.covariance @ information, np.eye(len(information)), atol=1e-6)
    assert step_left(posterior) < 0.1
    unknowns = posterior.unknowns
    for body in (unknowns.robot_body, unknowns.base_body, unknowns.stance_effective_body):
        covariance = posterior.covariance_of(body)
        np.testing.assert_allclose(covariance, covariance.T, atol=1e-12)
        assert (np.linalg.eigvalsh(covariance / np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))) > 0).all()


def test_evidence_narrows_the_prior(posterior):
    std = np.sqrt(np.diag(posterior.robot_covariance))
    before = posterior.std_before(posterior.unknowns.robot_body)
    assert (std < before).all()
    assert (std[1:4] < 0.1 * before[1:4]).all()


def test_every_motion_has_a_residual(posterior, evidence):
    assert [normalized_residual.motion for normalized_residual in posterior.residuals_of(TiltEquation)] == [
        m.index for m in evidence if m.lift is not None
    ]
    assert [normalized_residual.motion for normalized_residual in posterior.residuals_of(StanceMotions)] == [
        m.index for m in evidence if m.of(StanceMotion)
    ]
    assert all(
        normalized_residual.used and 0 < normalized_residual.normalized_residual < 4
        for normalized_residual in (*posterior.residuals_of(TiltEquation), *posterior.residuals_of(StanceMotions))
    )
    assert set(posterior.information) == set(posterior.gradient) <= {motion.index for motion in evidence}


# --- what is given, and what is missing


def test_a_scales_mass_is_reproduced(a1, bayesian_run, evidence):
    mass = bayesian_run.truth.composite.mass
    weighed = estimate_posterior(a1, bayesian_run.stance, evidence, mass=(mass, 1e-4), rounds=1)
    assert weighed.robot_body.mass == pytest.approx(mass, abs=5e-4)
    posterior = estimate_posterior(a1, bayesian_run.stance, evidence, rounds=1)
    sds = (np.sqrt(p.robot_covariance[0, 0]) for p in (weighed, posterior))
    assert next(sds) < 1.1e-4 < 0.01 * next(sds)
    assert weighed.robot_covariance[4, 4] < posterior.robot_covariance[4, 4]


def without_torques(recording):
    joints = recording.joints
    return replace(recording, joints=JointStream(joints.time, joints.position, joints.velocity))


def test_without_torques_the_mass_is_less_certain(a1, bayesian_run, evidence, posterior):
    """Torque constants are fixed."""
    known = Priors(torque_gain_common=1e-3)
    bare = read_motions(a1, bayesian_run.stance, [without_torques(recording) for recording in bayesian_run.recordings])
    assert not any(motion.of(TorqueSamples) for motion in bare)
    found = estimate_posterior(a1, bayesian_run.stance, bare, known)
    with_torques = estimate_posterior(a1, bayesian_run.stance, evidence, known)
    assert found.problem.equation(TorqueBalance) is None
    assert posterior.problem.equation(TorqueBalance) is not None
    assert found.robot_covariance[0, 0] > 4 * with_torques.robot_covariance[0, 0]
    off = found.robot_body.com - bayesian_run.truth.composite.com
    assert np.abs(off / np.sqrt(np.diag(found.robot_covariance))[1:4]).max() < SURE
    assert not any("torque gain" in finding.name for finding in sensor_findings(found))


def pushed(lift, size):
    """Return an oscillation along the base's x [m/s2], which is impossible for a free robot with this rotation."""
    push = size * np.outer(np.sin(np.linspace(0, 9, len(lift.joint_position))), [1, 0, 0])
    return replace(lift, acceleration_in_imu=lift.acceleration_in_imu + push)


def test_the_scale_of_all_masses_is_fixed_while_noise_levels_are_estimated(a1, bayesian_run, evidence):
    """The torque constants fix it, or, without torques, the model's mass."""
    silent = tuple(with_samples(motion, TorqueSamples) for motion in evidence)
    for read, name in ((evidence, "torque_gain_common"), (silent, "base")):
        problem = MapProblem(a1, bayesian_run.stance, read, Priors(), None, True)
        x = problem.unknowns.start()
        problem.prepare(x)
        x[problem.unknowns[name].start] += 0.1
        assert problem.normal_equations(x, fix_scale=True).cost > problem.normal_equations(x).cost + 0.5
    weighed = MapProblem(a1, bayesian_run.stance, evidence, Priors(), (12.0, 0.1), True)
    x = weighed.unknowns.start()
    weighed.prepare(x)
    assert weighed.normal_equations(x, fix_scale=True).cost == weighed.normal_equations(x).cost


@pytest.fixture(scope="module")
def scale(bayesian_run):
    """Return the robot's mass on a scale, and its standard deviation."""
    return bayesian_run.truth.composite.mass, 0.06


@pytest.fixture(scope="module")
def undisturbed(a1, bayesian_run, evidence, scale):
    return estimate_posterior(a1, bayesian_run.stance, evidence, mass=scale)


@pytest.mark.parametrize("size", [0.5, 2.0])
def test_a_lift_that_was_disturbed_is_left_out(a1, bayesian_run, evidence, scale, undisturbed, size):
    """An external force disturbs one lift of a weighed robot."""
    number = max(index for index, motion in enumerate(evidence) if motion.lift is not None)
    motions = list(evidence)
    motions[number] = with_samples(motions[number], LiftSamples, pushed(motions[number].lift, size))
    found = estimate_posterior(a1, bayesian_run.stance, tuple(motions), mass=scale)
    left_out = [
        normalized_residual.motion
        for normalized_residual in found.residuals_of(TiltEquation)
        if not normalized_residual.used
    ]
    assert evidence[number].index in left_out
    assert len(left_out) <= 2  # it draws the first round so far that another may seem wrong
    moved = components(found.robot_body) - components(undisturbed.robot_body)
    assert np.abs(moved / np.sqrt(np.diag(found.robot_covariance))).max() < 1
    assert step_left(found) < 0.5


def test_a_slightly_disturbed_lift_has_less_weight(a1, bayesian_run, evidence, posterior):
    fitting = min(
        (
            normalized_residual
            for normalized_residual in posterior.residuals_of(TiltEquation)
            if normalized_residual.used
        ),
        key=lambda normalized_residual: abs(normalized_residual.normalized_residual - 1),
    )
    number = next(index for index, motion in enumerate(evidence) if motion.index == fitting.motion)
    motions = list(evidence)
    motions[number] = with_samples(motions[number], LiftSamples, pushed(motions[number].lift, 0.05))
    found = estimate_posterior(a1, bayesian_run.stance, tuple(motions))
    before, after = (
        next(
            normalized_residual
            for normalized_residual in p.residuals_of(TiltEquation)
            if normalized_residual.motion == evidence[number].index
        )
        for p in (posterior, found)
    )
    assert after.used
    assert after.normalized_residual > 1.3 * before.normalized_residual
    assert np.trace(found.information[after.motion]) < 0.6 * np.trace(posterior.information[after.motion])


def test_without_a_lift_the_error_lists_the_reasons(a1, bayesian_run, evidence):
    motions = tuple(replace(motion, samples=(), left_out="the wind blew") for motion in evidence)
    with pytest.raises(RecordingError, match="no lift trial can be used: the wind blew"):
        estimate_posterior(a1, bayesian_run.stance, motions)


@pytest.mark.parametrize("count", [1, 5, 7, 10])
def test_the_first_motions_of_an_interrupted_run_give_an_estimate(a1, bayesian_run, evidence, count):
    few = evidence[:count]
    found = estimate_posterior(a1, bayesian_run.stance, few)
    assert found.robot_body.physical_defect() is None
    assert step_left(found) < 0.5


# --- noise of a lift


@pytest.mark.parametrize("noise", READINGS)
def test_a_lifts_noise_is_that_of_many_draws(a1, posterior, evidence, monkeypatch, noise):
    """Errors drawn with the stated std of one sensor give the stated noise of y over the inertia about the line."""
    monkeypatch.setattr("equipoise.estimator.equations.tilt._BIAS_FLOOR", 0.0)
    lift, generator, draws = lifts_of(evidence)[0], np.random.default_rng(4), 60
    others = {other: np.zeros_like(lift.velocity_noise) for other in READINGS if other != noise}
    read, of_sample = getattr(lift, READINGS[noise]), np.zeros(len(lift.joint_position))
    off = generator.multivariate_normal(of_sample, getattr(lift, noise), (draws, read.shape[1]), method="eigh")
    drawn = [replace(lift, **others, **{READINGS[noise]: read + part.T}) for part in off]
    values, inertial = posterior.unknowns.values(posterior.x), posterior.unknowns.inertial(posterior.x)
    equation = TiltInvariant(a1, LegChains(a1), [replace(lift, **others), *drawn])
    y, levers = equation.evaluate(values, inertial)
    exact, *noisy = (y[trial] / levers[0, 0] for trial in equation.trials)
    tilt_noise = TiltNoise.of(drawn[0])
    expected = tilt_noise.covariance(levers[1:, 0] / levers[0, 0]) - tilt_noise.unexplained
    ratio = np.sqrt(np.mean((np.array(noisy) - exact) ** 2) / np.diag(expected).mean())
    assert 0.75 < ratio < 1.33


def test_a_lifts_noise_grows_with_each_of_its_causes(evidence):
    lift, gains = lifts_of(evidence)[0], np.array([3.0, 0.1, 0.2, 0.1, *np.full(12, 0.02)])
    kinds = np.repeat(np.eye(3, dtype=bool), [1, 3, 12], axis=1)
    least = TiltNoise.of(lift).covariance(gains)
    np.linalg.cholesky(least)
    worse = [TiltNoise.of(replace(lift, **{name: 4 * getattr(lift, name)})).covariance(gains) for name in READINGS]
    worse += [TiltNoise.of(lift).covariance(gains * factor) for factor in np.where(kinds, 2.0, 1.0)]
    worse.append(TiltNoise.of(lift).raised(1.1, gains).covariance(gains))
    assert all(np.trace(noise) > 1.005 * np.trace(least) for noise in worse)


@pytest.mark.parametrize(("factor", "least", "most"), [(3.0, 0.1, 0.4), (30.0, 0.95, 1.05)])
def test_unmodelled_moments_fit_no_better_with_a_larger_inertia(evidence, factor, least, most):
    """Twice the inertia halves them and their noise, but not the noise of an ordinary residual."""
    lift, gains = lifts_of(evidence)[0], np.array([3.0, 1.0, 0.1, 0.1, *np.full(12, 0.02)])
    noise = TiltNoise.of(lift).raised(factor, gains)
    residual = np.sin(np.linspace(0.0, 3.0, len(lift.joint_position)))
    once, twice = (np.sum((noise.whitening(gains / by) @ residual / by) ** 2) for by in (1.0, 2.0))
    assert least < twice / once < most


# --- sensor findings


def test_findings_name_every_sensor_and_the_most_significant_first(a1, posterior):
    findings = sensor_findings(posterior)
    names = [finding.name for finding in findings]
    assert (
        len(names) == len(set(names)) == 12 + 3 + 3 + 3 + 3 + 3 + 3 + 3 + 1 + 1 + 1 + 1 + 1 + 1 + 2 + 2 + 2 + 1 + 12 + 3
    )
    surety = [abs(finding.value) / finding.std for finding in findings]
    assert surety == sorted(surety, reverse=True)
    zero = next(finding for finding in findings if finding.name == "FL_thigh_joint offset")
    index = a1.joint_names.index("FL_thigh_joint")
    assert zero.value == pytest.approx(posterior.unknowns.value(posterior.x, "joint_offset")[index])
    assert zero.std == pytest.approx(posterior.std("joint_offset")[index])


def off_by(posterior, name, index, value):
    unknowns, x = posterior.unknowns, posterior.x.copy()
    x[unknowns[name].start + index] = value / unknowns.scale[unknowns[name]][index]
    return replace(posterior, x=x)


@pytest.mark.parametrize(
    ("block", "index", "value", "name", "words"),
    [
        (
            "joint_offset",
            4,
            0.05,
            "FR_thigh_joint offset",
            "FR_thigh_joint: the joint offset is +2.86 deg (std 0.",
        ),
        ("imu_tilt", 1, -0.04, "IMU pitched", "the IMU is pitched by -2.29 deg (std 0."),
        (
            "accelerometer_bias",
            2,
            0.5,
            "accelerometer bias z",
            "the accelerometer's z reads +0.500 m/s2 too much (std 0.",
        ),
        (
            "clock_offset",
            0,
            4e-3,
            "clock offset",
            "IMU samples are 4.00 ms younger than joint samples of the same stamp",
        ),
        (
            "clock_offset",
            0,
            -4e-3,
            "clock offset",
            "IMU samples are 4.00 ms older than joint samples of the same stamp",
        ),
        ("foot_radius", 0, -0.3, "foot radius", "the rolling radius of the feet differs by -30.0% from the model"),
        ("floor_slope", 1, 0.05, "floor slope y", "the floor slopes along y by +2.86 deg (std 0."),
        (
            "torque_gain",
            0,
            0.5,
            "FL_hip_joint torque gain",
            "FL_hip_joint: the true torque differs by +50.0% from the reported one",
        ),
    ],
)
def test_a_large_error_has_a_message_and_is_significant(a1, posterior, block, index, value, name, words):
    found = next(f for f in sensor_findings(off_by(posterior, block, index, value)) if f.name == name)
    assert found.message.startswith(words)
    assert found.significant
    assert found.value == pytest.approx(value)


def test_a_small_or_uncertain_error_is_not_significant(a1, posterior):
    tiny = replace(off_by(posterior, "joint_offset", 4, 3e-3), covariance=1e-6 * posterior.covariance)
    unsure = replace(off_by(posterior, "joint_offset", 4, 0.05), covariance=1e6 * posterior.covariance)
    for changed in (tiny, unsure):
        assert not next(f for f in sensor_findings(changed) if f.name == "FR_thigh_joint offset").significant
