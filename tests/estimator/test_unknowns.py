"""Parameter table: a new parameter needs only a row and its equation."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from equipoise import Calibration, estimate
from equipoise.estimator import problem as problem_module
from equipoise.estimator.diagnostics.checks import run_checks
from equipoise.estimator.diagnostics.sensor_findings import sensor_findings
from equipoise.estimator.equations.equation import Equation
from equipoise.estimator.equations.stance_motion import StanceMotion, StanceMotions
from equipoise.estimator.equations.table import USUAL
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.measurements.momenta import model_parameters
from equipoise.estimator.measurements.tilt_invariant import TiltInvariant
from equipoise.estimator.motions import read_motions
from equipoise.estimator.parameters import Unknowns
from equipoise.estimator.prior_runs.two_runs import estimate_two_runs
from equipoise.estimator.problem import estimate_posterior
from equipoise.estimator.unknowns import AXIS, IMU, Priors, finding_names, model_values, unknown
from equipoise.report.contents import run_contents

# A second accelerometer, which on a bench read more than the first by this [m/s2].
MORE, BENCH = np.array([0.4, 0.0, -0.1]), 1e-3


@dataclass(frozen=True)
class TwoAccelerometers(Priors):
    """Priors with an additional row."""

    second_bias: float = unknown(
        0.2, "reading of a second accelerometer less specific force", "m/s2", AXIS, "made up",
        group=IMU, label="second accelerometer bias {each}",
        finding="second accelerometer bias {each}", significant=0.2, drift=0.5,
        advice="the second accelerometer's {each} reads {value:+.2f} m/s2 too much; take it off",
    )  # fmt: skip


class Bench(Equation):
    """Equation of a bench measurement, counted with the first motion."""

    depends_on = ("accelerometer_bias", "second_bias")
    source = "noise of the bench"

    @classmethod
    def of(cls, unknowns, motions):
        return cls(unknowns, [(0, MORE)])

    def _rows_in(self, sample):
        return len(sample)

    def residual(self, x):
        values = self.unknowns.values(x)
        return (values["second_bias"] - values["accelerometer_bias"] - MORE) / BENCH

    def linearise(self, x):
        scale = self.unknowns.scale[self.columns]
        return self.residual(x), np.hstack([-np.eye(3), np.eye(3)]) * scale / BENCH


@pytest.fixture
def bench(monkeypatch):
    monkeypatch.setattr(problem_module, "USUAL", (*USUAL, Bench))


@pytest.fixture(scope="module")
def few(a1, bayesian_run):
    """Return the first motions of a run, for a faster estimate."""
    return read_motions(a1, bayesian_run.stance, bayesian_run.recordings)[:8]


@pytest.mark.usefixtures("bench")
def test_an_additional_row_is_estimated_reported_and_written(a1, bayesian_run, tmp_path):
    settings = replace(bayesian_run.settings, priors=TwoAccelerometers())
    result = estimate(a1, bayesian_run.recordings, settings)
    found = {finding.name: finding for finding in result.sensors}
    for axis, more in zip("xyz", MORE, strict=True):
        first, second = found[f"accelerometer bias {axis}"], found[f"second accelerometer bias {axis}"]
        assert second.value - first.value == pytest.approx(more, abs=5 * BENCH)
        assert first.std < second.std < first.std + BENCH
    bias_finding = found["second accelerometer bias x"]
    message = f"the second accelerometer's x reads {bias_finding.value:+.2f} m/s2 too much; take it off"
    assert bias_finding.message == message
    assert bias_finding.significant
    assert not found["second accelerometer bias y"].significant
    result.save(tmp_path / "calibration.json")
    again = Calibration.load(tmp_path / "calibration.json")
    assert again.sensors == result.sensors
    assert again.settings["priors"]["second_bias"] == 0.2
    assert message in str(run_contents(result))


@pytest.mark.usefixtures("bench")
def test_a_row_determines_if_the_sensor_check_tests_it(a1, bayesian_run, few):
    for prior, passed in ((0.2, True), (0.05, False)):
        found = estimate_posterior(a1, bayesian_run.stance, few, TwoAccelerometers(second_bias=prior))
        check = next(check for check in run_checks(found) if check.name == "sensor errors")
        assert check.passed == passed
        assert ("second accelerometer bias x" in check.message) or passed


@pytest.mark.usefixtures("bench")
def test_a_row_determines_the_common_part_of_two_runs(a1, bayesian_run, few):
    runs = estimate_two_runs(a1, bayesian_run.stance, (few, few), TwoAccelerometers())
    unknowns, size = runs.unknowns, runs.unknowns.size
    change = np.hstack([-np.eye(size), np.eye(size)])
    std = np.sqrt(np.diag(change @ runs.covariance @ change.T))
    assert (std[unknowns["second_bias"]] > 1e-3).all()
    assert (std[unknowns["joint_offset"]] < 1e-6).all()


def test_a_row_without_an_equation_is_not_reported(a1, bayesian_run, few):
    found = estimate_posterior(a1, bayesian_run.stance, few, TwoAccelerometers())
    assert "second_bias" not in found.informed
    np.testing.assert_allclose(found.unknowns.value(found.x, "second_bias"), 0, atol=1e-12)
    np.testing.assert_allclose(found.std("second_bias"), 0.2)


# --- what holds for every row


def test_equations_depend_on_the_rows_that_they_list(a1, bayesian_run, few):
    """They get no other value."""
    legs, values = LegChains(a1), model_values(a1)
    lifts = [motion.lift for motion in few if motion.lift is not None]
    moves = [move for motion in few for move in motion.of(StanceMotion)]
    moves[-1] = replace(moves[-1], heading=np.pi)
    _, _, by_y, _ = TiltInvariant(a1, legs, lifts).linearise(values, model_parameters(a1))
    standing = StanceMotions(Unknowns(a1, bayesian_run.stance, Priors()), [*enumerate(moves)])
    _, by_rows = standing.derivatives(values)
    for names, by in ((TiltInvariant.DEPENDS_ON, by_y), (StanceMotions.depends_on, by_rows)):
        assert set(by) - {"inertial"} == set(names)
        assert all((np.abs(part) > 1e-9).any() for part in by.values())


@pytest.mark.parametrize("row", Priors.rows(), ids=lambda row: row.name)
def test_every_row_is_complete(a1, row):
    labels = row.each.labels(a1)
    assert len(set(labels)) == len(labels) > 0
    assert row.meaning
    assert row.source
    assert row.label
    assert ("{each}" in row.label) == (len(labels) > 1)
    assert bool(row.finding) == bool(row.advice)
    if row.finding:
        assert len(set(finding_names(a1, row.name))) == len(labels)
        assert all(row.message(labels[0], sign * 0.1, 0.01) for sign in (-1, 1))


def test_every_row_enters_an_equation(a1, bayesian_run, few):
    found = estimate_posterior(a1, bayesian_run.stance, few)
    assert found.informed == {"base", *(row.name for row in Priors.rows())}


@pytest.fixture(scope="module")
def opened(a1, bayesian_run, few):
    """Return the posterior of a run without fixed rows."""
    return estimate_posterior(a1, bayesian_run.stance, few, Priors().all_open, rounds=0)


@pytest.mark.parametrize("row", Priors.rows(), ids=lambda row: row.name)
def test_any_row_can_be_fixed(a1, bayesian_run, few, opened, row):
    """The estimate works without it and has no finding about it."""
    held = estimate_posterior(a1, bayesian_run.stance, few, Priors().all_open.holding(row.name), rounds=0)
    assert len(held.x) == len(opened.x) - len(row.each.labels(a1))
    assert not held.unknowns.values(held.x)[row.name].any()
    names, all_names = ({finding.name for finding in sensor_findings(found)} for found in (held, opened))
    assert all_names - names == (set(finding_names(a1, row.name)) if row.finding else set())
    assert np.isfinite(held.robot_covariance).all()


def test_finding_names_are_those_of_the_findings(a1):
    assert finding_names(a1, "imu_tilt") == ["IMU rolled", "IMU pitched", "IMU yawed"]
    assert finding_names(a1, "joint_offset")[1] == "FL_thigh_joint offset"
