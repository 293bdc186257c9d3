"""Baselines in benchmarks/baselines_of_others recover the body from noise-free motions, so that the comparison is valid."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from tilting import contact_jacobian

from equipoise import nominal_stance
from equipoise.robot.inertial import base_parameters, components, composite_parameters

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))  # last: some names equal those of tests

from baselines_of_others import projected_least_squares, rigid_body_kalman
from baselines_of_others.filtered import Filtered
from baselines_of_others.projected_least_squares import ProjectedSettings
from baselines_of_others.rigid_body_kalman import KalmanSettings

LOSSES = 0.4, 0.07, 0.015  # Coulomb [Nm], viscous [Nm s/rad], armature [kg m2]
PAYLOAD = pin.Inertia(1.5, np.array([0.08, -0.03, 0.07]), np.diag([0.004, 0.007, 0.006]))


@pytest.fixture(scope="module")
def loaded(a1):
    """A1 with a payload that its model does not have."""
    return a1.with_base(base_parameters(a1).to_pinocchio() + PAYLOAD)


@pytest.fixture(scope="module")
def samples(loaded):
    """Random motion on four feet with random forces, then on two."""
    generator = np.random.default_rng(5)
    model, joints = loaded.pinocchio.copy(), len(loaded.joint_names)
    model.gravity.linear = np.zeros(3)
    data, rows, count = model.createData(), [], 300
    for index in range(count):
        standing = np.array([True, index < count // 2, index < count // 2, True])
        position = nominal_stance(loaded).joint_position + 0.1 * generator.standard_normal(joints)
        velocity, acceleration = generator.standard_normal(joints), 10 * generator.standard_normal(joints)
        up = np.array([0.05, -0.03, 1.0]) / np.linalg.norm([0.05, -0.03, 1.0])
        feet = np.repeat(standing, 3)
        q = loaded.configuration(position)
        jacobian = contact_jacobian(loaded, q, -up)[feet]
        turning, turning_rate = generator.standard_normal(3), 8 * generator.standard_normal(3)
        felt = 9.81 * up + generator.standard_normal(3)
        v = np.concatenate([np.zeros(3), turning, velocity])
        a = np.concatenate([felt, turning_rate, acceleration])
        if not standing.all():  # the body falls about the line between its feet: no moment about it
            along = jacobian[3:, 3:6] - jacobian[:3, 3:6]
            line = np.array([along[2, 1], along[0, 2], along[1, 0]])
            a[3:6] += line * _rate_that_balances(model, data, q, v, a, jacobian, line)
        needed = pin.rnea(model, data, q, v, a)
        force = 30 * generator.standard_normal(len(jacobian))
        force += np.linalg.pinv(jacobian[:, :6].T) @ (needed[:6] - jacobian[:, :6].T @ force)
        link = needed - jacobian.T @ force
        assert np.abs(link[:6]).max() < 1e-6
        friction = np.tanh(velocity / 0.03)
        lost = LOSSES[0] * friction + LOSSES[1] * velocity + LOSSES[2] * acceleration
        rows.append((position, velocity, acceleration, link[6:] + lost, friction, turning, a[3:6], felt, up, standing))
    return Filtered(*(np.array(column) for column in zip(*rows, strict=True)))


def _rate_that_balances(model, data, q, v, a, jacobian, line):
    """Return the additional angular acceleration about the line that zeroes the moment about it."""

    def moment(rate):
        changed = a.copy()
        changed[3:6] += rate * line
        wrench = pin.rnea(model, data, q, v, changed)[:6]
        basis = np.linalg.svd(jacobian[:, :6])[2][5]  # wrench that forces at two points cannot produce
        return basis @ wrench

    zero, one = moment(0.0), moment(1.0)
    return -zero / (one - zero)


def true_body(robot):
    return components(composite_parameters(robot, nominal_stance(robot).joint_position))


@pytest.mark.parametrize("legs", ["known", "free"])
@pytest.mark.parametrize("losses", ["shared", "joint"])
def test_projected_least_squares_recovers_a_payload(a1, loaded, samples, legs, losses):
    """Errors are below a millionth; parameters of links that cannot be identified stay the model's."""
    settings = ProjectedSettings(legs=legs, losses=losses)
    stance = nominal_stance(a1).joint_position
    found = projected_least_squares.estimate(a1, samples, stance, settings)
    np.testing.assert_allclose(components(found), true_body(loaded), atol=2e-5)
    theta = projected_least_squares.solve(projected_least_squares.pose(a1, samples, settings))
    sets = 1 if losses == "shared" else 12
    np.testing.assert_allclose(theta[-3 * sets :], np.repeat(LOSSES, sets), atol=1e-4)


def test_projected_least_squares_uses_the_mass_from_the_scale(a1, loaded, samples):
    settings, stance = ProjectedSettings(), nominal_stance(a1).joint_position
    found = projected_least_squares.estimate(a1, samples, stance, settings, mass=1.02 * loaded.mass)
    assert found.mass == pytest.approx(1.02 * loaded.mass, rel=1e-9)


def test_matrix_inequalities_keep_a_body_physically_possible(a1, samples):
    pytest.importorskip("cvxpy")
    settings = ProjectedSettings()
    problem = projected_least_squares.pose(a1, samples, settings)
    same = projected_least_squares.minimum_with_matrix_inequalities(problem, 1e-6, None)
    np.testing.assert_allclose(same, projected_least_squares.solve(problem), atol=1e-3)
    noisy = replace(problem, moment=problem.moment + 60 * np.random.default_rng(2).standard_normal(len(same)))
    assert not projected_least_squares.consistent(noisy, projected_least_squares.minimum(noisy, 1.0, None))
    found = pin.Inertia.FromDynamicParameters(
        projected_least_squares.minimum_with_matrix_inequalities(noisy, 1.0, None)[:10]
    )
    moments = np.linalg.eigvalsh(found.inertia)
    assert found.mass > 0
    assert moments[0] > -1e-6
    assert moments[2] <= moments[0] + moments[1] + 1e-6


def test_the_kalman_filter_converges_on_a_payload(a1, loaded, samples):
    """Errors are below a thousandth without a scale, and larger with half of the samples."""
    settings, stance = KalmanSettings(torque_sd=0.01, acceleration_sd=1e-3), nominal_stance(a1).joint_position
    found = components(rigid_body_kalman.estimate(a1, samples, stance, settings))
    true = true_body(loaded)
    np.testing.assert_allclose(found, true, atol=1e-3)
    few = Filtered(*(getattr(samples, name)[:6] for name in Filtered.__dataclass_fields__))
    early = rigid_body_kalman.run(a1, few, stance, settings)
    late = rigid_body_kalman.run(a1, samples, stance, settings)
    assert (np.diag(late.covariance) < np.diag(early.covariance)).all()
    np.testing.assert_allclose(late.state[10:], LOSSES, atol=2e-3)
    base = base_parameters(loaded).to_pinocchio().toDynamicParameters()
    assert np.linalg.norm(late.state[:10] - base) < np.linalg.norm(early.state[:10] - base)
