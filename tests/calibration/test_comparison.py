"""Payload added to a robot between two calibrations."""

import dataclasses
import json

import numpy as np
import pytest

from equipoise import (
    BayesianMethod,
    PaperMethod,
    RunFolder,
    ScaleReadings,
    find_payload_change,
    nominal_stance,
    simulate,
)
from equipoise.calibration.payload_change import _payload
from equipoise.calibration.routine import perform
from equipoise.cli import main
from equipoise.errors import RecordingError, SettingsError
from equipoise.estimator.motions import read_motions
from equipoise.estimator.prior_runs.two_runs import _TwoProblems
from equipoise.estimator.unknowns import Priors
from equipoise.recording.trials import LiftTrial
from equipoise.result.body import Body
from equipoise.robot.inertial import InertialParameters

PAYLOAD = (1.5, 0.05, -0.02, 0.06)  # of the fixture `bayesian_run`


@pytest.fixture(scope="module")
def bare(a1):
    """Recordings and truth of the robot of `bayesian_run` without its payload and with other noise."""
    settings = BayesianMethod(duration=40, excitation=False)
    with simulate(a1, "realistic", seed=4, noise_seed=104) as simulation:
        return perform(simulation.platform, a1, settings).recordings, simulation.truth


@pytest.fixture(scope="module")
def scale(bare, bayesian_run):
    """Readings of a scale with a gain error of half a percent and a resolution of ten grams."""
    return ScaleReadings(tuple(round(1.005 * truth.composite.mass, 2) for truth in (bare[1], bayesian_run.truth)))


@pytest.fixture(scope="module")
def weighed(a1, bare, bayesian_run, scale):
    return find_payload_change(a1, bare[0], bayesian_run.recordings, scale).with_truth(bare[1], bayesian_run.truth)


def test_a_payload_is_found_within_its_intervals(weighed):
    payload = weighed.payload
    assert payload.truth.mass == pytest.approx(PAYLOAD[0])
    assert np.allclose(payload.truth.com, PAYLOAD[1:])
    assert payload.mass.value == pytest.approx(PAYLOAD[0], rel=0.02)
    assert np.allclose(payload.com_in_base.values[:2], PAYLOAD[1:3], atol=0.005)
    assert not weighed.removed
    assert not weighed.warnings
    true = np.array([payload.truth.mass, *payload.truth.com, *6 * [0.0]])
    off = np.abs(payload.values - true) / payload.stds
    assert (off < 1.96).sum() >= 9, off  # of ten intervals of 95 %
    assert off.max() < 3
    assert payload.mass.verdict == "identified"
    assert payload.inertia.Ixx.verdict != "identified"  # a point has none


def test_common_errors_cancel(a1, bare, bayesian_run, weighed):
    apart = bayesian_run.result.composite.mass.std
    alone = find_payload_change(a1, bare[0], bayesian_run.recordings)
    assert alone.payload.mass.std < apart
    assert weighed.payload.mass.std < 0.2 * alone.payload.mass.std
    assert abs(alone.payload.mass.value - PAYLOAD[0]) < 2 * alone.payload.mass.std


def test_a_removed_payload_is_the_same_body(a1, bare, bayesian_run, scale, weighed):
    removed = find_payload_change(
        a1, bayesian_run.recordings, bare[0], dataclasses.replace(scale, masses=scale.masses[::-1])
    )
    removed = removed.with_truth(bayesian_run.truth, bare[1])
    assert removed.removed
    assert removed.payload.truth.mass == pytest.approx(PAYLOAD[0])
    assert removed.payload.mass.value == pytest.approx(weighed.payload.mass.value, rel=5e-3)
    assert np.allclose(removed.payload.com_in_base.values, weighed.payload.com_in_base.values, atol=1e-3)
    assert removed.change.mass.value < 0


def test_without_a_payload_only_the_mass_is_estimated(a1, bare):
    nothing = find_payload_change(a1, bare[0], bare[0])
    mass, *others = nothing.payload
    assert all(quantity.value is quantity.std is quantity.verdict is None for quantity in others)
    assert list(nothing.to_dict()["intervals"]) == ["mass"]
    assert abs(mass.value) < 0.05 * mass.std
    assert mass.verdict == ("no change" if mass.half_width < 0.01 * a1.mass else "not identified")
    assert {quantity.verdict for quantity in nothing.change} <= {"no change", "not identified"}


def test_only_a_certain_zero_is_no_change():
    values, stds = np.array([0.01, *9 * [1e-4]]), np.array([0.02, 5e-4, 5e-4, 5e-3, 1e-3, *5 * [0.1]])
    typical = np.abs(values)
    change = Body.of(values, np.diag(stds**2), typical).with_sure_zeros(np.repeat([0.1, 2e-3, 0.02], [1, 3, 6]))
    assert [one.verdict for one in change] == ["no change"] * 3 + ["not identified", "no change"] + 5 * [
        "not identified"
    ]
    sure = Body.of(10 * values, np.diag(stds**2), typical).with_sure_zeros(np.full(10, 0.1))
    assert sure.mass.verdict != "no change"  # 0.1 +- 0.04 kg is a change


def test_derivatives_of_two_runs_are_those_of_their_cost(a1, bare, bayesian_run):
    stance = nominal_stance(a1)
    evidences = tuple(read_motions(a1, stance, recordings) for recordings in (bare[0], bayesian_run.recordings))
    problem = _TwoProblems(a1, stance, evidences, Priors(), ScaleReadings((12.5, 13.9)))
    generator = np.random.default_rng(1)
    z = problem.start()
    z[10:] += 0.1 * generator.standard_normal(len(z) - 10) * np.append(np.ones(len(z) - 11), 5e-3)
    problem.prepare(z)
    gradient = problem.normal_equations(z).gradient
    for index in (0, 7, 12, problem.unknowns.size, problem.unknowns.size + 5, len(z) - 1):
        step = np.zeros_like(z)
        step[index] = 2e-4  # smaller steps are below the rounding error of the cost
        ahead, behind = (problem.normal_equations(z + sign * step).cost for sign in (1, -1))
        slope = (ahead - behind) / 4e-4
        assert 2 * gradient[index] == pytest.approx(slope, rel=1e-3, abs=1e-2), index


def test_bodies_are_recovered_from_base_vectors():
    body = InertialParameters(0.8, [0.1, -0.02, 0.05], [[3e-3, 1e-4, 0], [1e-4, 4e-3, -2e-4], [0, -2e-4, 5e-3]])
    found = InertialParameters.from_vector(body.vector)
    assert found.mass == pytest.approx(body.mass)
    assert np.allclose(found.com, body.com)
    assert np.allclose(found.inertia, body.inertia)


def test_verdicts_depend_on_the_size_of_a_quantity():
    vector = np.array([1.0, 0.1, 0, 0, 0.01, 0, 0.02, 0, 0, 0.02])
    covariance = np.diag(np.array([0.05, 1e-3, 0.04, 0.2, *6 * [1e-3]]) ** 2)
    mass, *others = _payload(vector, covariance, length=0.18)
    assert [quantity.verdict for quantity in (mass, *others[:3])] == [
        "identified",
        "identified",
        "weak",
        "not identified",
    ]


def test_invalid_scales_are_rejected():
    with pytest.raises(SettingsError, match=r"a mass of 0 kg is too small; pass at least 0\.05 kg"):
        ScaleReadings((0.0, 1.0))
    with pytest.raises(SettingsError, match=r"noise of the scale is -1; it must be above 0 and below 1"):
        ScaleReadings(noise=-1)


def test_a_run_without_lifts_is_rejected(a1, bare, bayesian_run):
    no_lifts = [recording for recording in bare[0] if not isinstance(recording.trial, LiftTrial)]
    with pytest.raises(RecordingError, match="the second run: no lift trial can be used"):
        find_payload_change(a1, bayesian_run.recordings, no_lifts)


# --- the command line


@pytest.fixture(scope="module")
def folders(a1, bare, bayesian_run, tmp_path_factory):
    path = tmp_path_factory.mktemp("compare")
    settings = bayesian_run.settings
    runs = {"before": bare, "after": (bayesian_run.recordings, bayesian_run.truth)}
    for name, (recordings, truth) in runs.items():
        with RunFolder.create(path / name, a1, settings, {}) as folder:
            folder.save_truth(truth)
            for recording in recordings:
                folder.keep(recording)
    return path


def test_the_command_prints_the_payload(folders, scale, weighed, capsys):
    before, after = (str(mass) for mass in scale.masses)
    runs = [str(folders / "before"), str(folders / "after"), "--mass", before, after]
    out = folders / "delta.json"
    assert main(["compare", *runs, "--json", "--out", str(out)]) == 0
    table = json.loads(capsys.readouterr().out)
    assert table["schema"] == "equipoise.payload_change/1"
    assert table["payload"]["mass"] == pytest.approx(weighed.payload.mass.value)
    assert table["truth"]["mass"] == pytest.approx(PAYLOAD[0])
    assert table["provenance"]["masses"] == [float(before), float(after)]
    assert json.loads(out.read_text(encoding="utf-8")) == table
    assert main(["compare", *runs]) == 0
    text = capsys.readouterr().out
    assert "unitree_a1: payload that was added" in text
    assert f"{weighed.payload.mass.value:.3f}" in text
    shared = " ".join(text.split())
    assert "its readings share an error of 0.5%, and each has one of 0.1% (standard deviations)" in shared


def test_incomparable_runs_are_rejected(folders, tmp_path, capsys):
    paper = tmp_path / "paper"
    header = json.loads((folders / "before" / "run.json").read_text(encoding="utf-8"))
    paper.mkdir()
    for name in ("model.xml", "recording_0.mcap"):
        (paper / name).write_bytes((folders / "before" / name).read_bytes())
    header["settings"], bayesian = PaperMethod().to_dict(), header["settings"]
    (paper / "run.json").write_text(json.dumps(header), encoding="utf-8")
    assert main(["compare", str(paper), str(folders / "after")]) == 2
    assert "is of the method 'paper'; compare runs of the method 'bayesian'" in capsys.readouterr().err
    header["settings"] = bayesian
    header["description"]["foot_radius"] = 0.03
    (paper / "run.json").write_text(json.dumps(header), encoding="utf-8")
    assert main(["compare", str(paper), str(folders / "after")]) == 2
    assert "the runs have different models" in capsys.readouterr().err
    assert main(["compare", str(folders / "after"), str(folders / "after")]) == 2
    assert "is named twice" in capsys.readouterr().err
    assert main(["compare", str(folders / "nothing"), str(folders / "after")]) == 5
    assert "name the run folder of a calibration" in capsys.readouterr().err
