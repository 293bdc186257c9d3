"""Errors planted in the recordings of a realistic run, as the sensors would show them: they are found, and the body stays."""

from dataclasses import replace

import numpy as np
import pytest

from equipoise.precise.measurements.evidence import read_evidence
from equipoise.precise.posterior import estimate_posterior
from equipoise.precise.unknowns import Priors
from equipoise.robot.inertial import components

SURE = 5.0  # standard deviations
HELD = 1e-9


def posterior_of(a1, run, recordings, **priors):
    evidence = read_evidence(a1, run.stance, recordings)
    return estimate_posterior(a1, run.stance, evidence, Priors(**priors), (run.truth.composite.mass, 0.06))


@pytest.fixture(scope="module")
def plain(a1, precise_run):
    return posterior_of(a1, precise_run, precise_run.recordings)


def moved(found, plain):
    """Of the body's ten parameters, in standard deviations that are reported."""
    return (components(found.robot_body) - components(plain.robot_body)) / np.sqrt(np.diag(found.robot_covariance))


def gained(found, plain, name):
    """How much more of an unknown is found than was there before."""
    return found.unknowns.value(found.x, name) - plain.unknowns.value(plain.x, name)


def with_gyroscope(recordings, error):
    """Readings of which (1 - error) is true."""
    read = np.linalg.inv(np.eye(3) - error)

    def seen(recording):
        imu = recording.imu
        return replace(recording, imu=replace(imu, angular_velocity_in_imu=imu.angular_velocity_in_imu @ read.T))

    return [seen(recording) for recording in recordings]


def test_gains_and_misalignment_of_the_gyroscope(a1, precise_run, plain):
    gains, beside = np.array([0.012, -0.01, 0.008]), np.array([6e-3, -4e-3, -7e-3, 5e-3, 3e-3, -6e-3])
    error = np.diag(gains)
    error[~np.eye(3, dtype=bool)] = beside
    recordings = with_gyroscope(precise_run.recordings, error)
    found = posterior_of(a1, precise_run, recordings)
    for name, planted in (("gyro_gain", gains), ("gyro_misalignment", beside)):
        told = 1 - (found.deviation(name) / found.unknowns.scale[found.unknowns[name]]) ** 2
        np.testing.assert_allclose(gained(found, plain, name), told * planted, atol=0.6e-3, err_msg=name)
    assert np.abs(moved(found, plain)).max() < 1
    held = posterior_of(a1, precise_run, recordings, gyro_gain=HELD, gyro_misalignment=HELD)
    assert np.abs(moved(held, plain)).max() > 2
