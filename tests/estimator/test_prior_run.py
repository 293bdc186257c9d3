"""Runs with a prior run: priors, changes, refusals."""

import json
from dataclasses import replace

import numpy as np
import pytest

from equipoise import BayesianMethod, RunFolder, calibrate, estimate, nominal_stance, simulate
from equipoise.bayesian.planning.nominal import nominal_candidates
from equipoise.bayesian.short_plan import opening_moves
from equipoise.bayesian.trials import BayesianTrials
from equipoise.calibration.payload_measurement import measure_payload
from equipoise.cli import main
from equipoise.errors import NotEstimatedError, RecordingError, SettingsError
from equipoise.estimator.motions import read_motions
from equipoise.estimator.parameters import Unknowns
from equipoise.estimator.prior_runs.both_runs import both_runs
from equipoise.estimator.prior_runs.changes import estimate_with_prior_run, prior_run_check
from equipoise.estimator.prior_runs.prior_run import POSTERIOR, SCALE_GAIN, PriorRun, shared_places
from equipoise.experiments.stand import stand_up
from equipoise.result.held_out import FOUND, MODEL, PRIOR_RUN
from equipoise.result.requirements import UNMET
from equipoise.robot.inertial import composite_parameters

MOVED = 6e-3  # [rad]


@pytest.fixture(scope="module")
def earlier(bayesian_run):
    """Return a run with a payload as the prior run."""
    return PriorRun.of(bayesian_run.result.evidence.posterior, bayesian_run.result.settings)


@pytest.fixture(scope="module")
def later(a1, earlier):
    """Return a run without that payload: method, recordings and result."""
    method, recordings = BayesianMethod(prior_run=earlier, duration=26), []
    with simulate(a1, "realistic", seed=4, noise_seed=104) as simulation:
        result = calibrate(simulation.platform, a1, method, keep=recordings.append)
        return method, recordings, result.with_truth(simulation.truth)


def test_a_short_run_finds_the_com_and_the_removed_payload(a1, earlier, later, bayesian_run):
    _, recordings, result = later
    assert sum(recording.duration for recording in recordings) < 26
    assert [recording.trial.kind for recording in recordings[:5]] == ["posture"] * 3 + ["lift"] * 2
    assert np.hypot(*result.composite.com_in_base.errors[:2]) < 1.5e-3
    assert not any(quantity.missed for quantity in result.composite)
    assert not result.evidence.changes
    found = measure_payload(a1, earlier, result)
    payload = found.change.with_truth(bayesian_run.truth, result.truth).payload
    assert found.answer == "removed"
    assert payload.mass.value == pytest.approx(1.5, rel=0.2)
    assert not any(quantity.missed for quantity in payload)
    assert "removed" in found.message
    assert found.to_dict()["answer"] == "removed"


def test_the_prior_runs_body_predicts_worse_without_its_payload(later):
    found = later[2].held_out
    assert found.bodies == (MODEL, PRIOR_RUN, FOUND)
    assert found.error(PRIOR_RUN) > 3 * max(found.error(FOUND), found.error(MODEL))
    assert "with the prior run's body off by" in found.message()


def test_the_covariance_of_both_runs_is_that_of_one_estimate(earlier, later):
    """Combine the prior run's Gaussian, its changes and the later run's evidence to one Gaussian."""
    posterior = later[2].evidence.posterior
    runs, unknowns = both_runs(earlier, posterior), posterior.unknowns
    size, rows = unknowns.size, unknowns.tabled
    evidence = np.linalg.inv(posterior.covariance)
    evidence[rows, rows] -= unknowns.run_prior.information
    here, there = shared_places(unknowns, earlier.earlier(unknowns)[2])
    change = np.eye(size)[rows]  # of what is not kept: all of it
    from_first = np.zeros((size, size))
    from_first[here, there] = 1.0
    free = unknowns.run_prior.covariance.diagonal() - (from_first @ earlier.spread @ from_first.T).diagonal()[rows]
    steps = np.hstack([-from_first[rows], change]) / np.sqrt(np.maximum(free, 1e-7))[:, None]
    information = steps.T @ steps
    information[:size, :size] += np.linalg.inv(earlier.spread)
    information[size:, size:] += evidence
    together = np.linalg.inv(information)
    std = np.sqrt(together.diagonal())
    np.testing.assert_allclose(runs.covariance / np.outer(std, std), together / np.outer(std, std), atol=1e-2)


def test_kept_rows_are_the_prior_and_the_base_is_not(a1, earlier):
    unknowns = Unknowns(a1, nominal_stance(a1), BayesianMethod(prior_run=earlier).combined_priors)
    belief, first = earlier.distribution(unknowns), unknowns.tabled.start
    spread = np.sqrt(np.diag(belief.covariance))
    of = {row.name: spread[unknowns[row.name].start - first : unknowns[row.name].stop - first] for row in unknowns.rows}
    assert (of["joint_offset"] < 1).all()
    assert (of["joint_offset"] > 0.1).all()  # switched off in between
    # Without this prior, a short run would have to estimate the vertical again: half a millimetre of CoM x.
    assert (of["accelerometer_bias"] < 1).all()
    assert (of["accelerometer_bias"] > 0.2).all()  # another temperature
    for name in ("floor_slope", "clock_offset"):
        np.testing.assert_array_equal(of[name], 1)
    assert len(belief.mean) == unknowns.size - 10


def test_a_scale_that_weighs_twice_has_one_gain(a1, earlier, later):
    weighed = replace(earlier, weighed=14.0 * 1.004)
    method = BayesianMethod(prior_run=weighed, mass=12.5)
    assert method.scale == (12.5, pytest.approx(0.0125))
    assert BayesianMethod(prior_run=weighed, mass=12.5, mass_std=0.1).scale == (12.5, 0.1)  # another scale
    unknowns = Unknowns(a1, nominal_stance(a1), method.combined_priors)
    x, spread, layout = weighed.earlier(unknowns)
    mass = layout.robot_body(x).mass
    assert layout.value(x, "scale_gain")[0] == pytest.approx(weighed.weighed / mass - 1)
    # Who thinks the robot heavier thinks the scale reads less.
    assert spread[layout["scale_gain"], layout["torque_gain_common"]].item() < 0
    assert layout.scale[layout["scale_gain"]][0] == SCALE_GAIN


@pytest.fixture(scope="module")
def moved(a1, earlier):
    """Return posterior and changes from the first moves of a run whose FL_thigh_joint has a new offset."""
    stance, method, recordings = nominal_stance(a1), BayesianMethod(prior_run=earlier), []
    with simulate(a1, "realistic", seed=4, noise_seed=105) as simulation:
        simulation.errors.drawn["joint_offset"][1] += MOVED
        standing, _ = stand_up(simulation.platform, a1, stance)
        trials = BayesianTrials(standing, stance, composite_parameters(a1, stance.joint_position).com)
        for posture in opening_moves(nominal_candidates(a1, method.combined_priors), earlier):
            recordings.append(trials.take_posture(posture))
    evidence = read_motions(a1, stance, recordings)
    return estimate_with_prior_run(a1, stance, evidence, method.combined_priors, None, earlier, lifts_needed=False)


def test_a_changed_joint_offset_is_found_from_the_first_moves(moved, earlier):
    _, (change,) = moved
    assert change.each == "FL_thigh_joint"
    assert change.value == pytest.approx(MOVED, abs=3 * change.std)
    assert "joint offset of FL_thigh_joint changed by" in change.finding().message
    check = prior_run_check((change,), earlier)
    assert check.passed
    assert change.message in check.message
    assert not prior_run_check(4 * (change,), earlier).passed


def test_a_change_is_not_common_to_both_runs(earlier, moved):
    posterior, changes = moved
    as_if_not, known = both_runs(earlier, posterior), both_runs(earlier, posterior, changes)
    place = changes[0].place
    size = known.unknowns.size
    assert abs(known.first[place] - earlier.x[place]) < 0.2 * abs(as_if_not.first[place] - earlier.x[place])
    assert (np.linalg.eigvalsh(known.covariance) > -1e-9).all()
    assert known.covariance.shape == (2 * size, 2 * size)


def test_a_payload_needs_the_evidence_of_the_result(a1, earlier, later):
    with pytest.raises(NotEstimatedError, match="a run or a log that is estimated in this process"):
        measure_payload(a1, earlier, replace(later[2], evidence=None))


# --- on disk


@pytest.fixture
def folder(a1, bayesian_run, tmp_path):
    with RunFolder.create(tmp_path / "last", a1, bayesian_run.settings, {}) as folder:
        pass
    folder.save(bayesian_run.result)
    return folder.path


def test_a_run_keeps_its_posterior_for_the_next_one(a1, folder, earlier, later, tmp_path):
    method = replace(later[0], prior_run=PriorRun.read(folder))
    assert method.prior_run == earlier
    with RunFolder.create(tmp_path / "next", a1, method, {}) as following:
        for recording in later[1]:
            following.keep(recording)
    for file in folder.iterdir():
        file.unlink()  # nothing of it is needed any more
    opened = RunFolder.open(tmp_path / "next")
    assert opened.method() == method
    assert "covariance" not in (following.path / "run.json").read_text(encoding="utf-8")
    again = estimate(a1, opened.recordings(), opened.method())
    np.testing.assert_allclose(again.composite.values, later[2].composite.values, rtol=1e-9, atol=1e-12)


def test_default_settings_have_no_prior_run():
    assert "known" not in BayesianMethod().to_dict()
    assert not BayesianMethod().attachments()


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        (lambda table: {**table, "schema": "equipoise.posterior/9"}, "'equipoise.posterior/9'; this version reads"),
        (lambda table: {**table, "x": table["x"][:-1]}, "rows of 1 to"),
        (
            lambda table: {**table, "x": [None, *table["x"][1:]]},
            r"damaged \(x\[0\] is None; it must be a number\); delete",
        ),
        (lambda table: {**table, "x": [float("nan"), *table["x"][1:]]}, "its parameters are not finite"),
        (lambda table: {**table, "x": ["much", *table["x"][1:]]}, "damaged"),
        (
            lambda table: {**table, "covariance": [[-value for value in row] for row in table["covariance"]]},
            "not positive definite",
        ),
        (lambda table: {name: value for name, value in table.items() if name != "model"}, "damaged"),
        (lambda table: [], "damaged"),
    ],
)
def test_a_damaged_posterior_is_refused_by_name(folder, harm, message):
    path = folder / POSTERIOR
    path.write_text(json.dumps(harm(json.loads(path.read_text(encoding="utf-8")))), encoding="utf-8")
    with pytest.raises(RecordingError, match=f"--prior-run .*last: .*{message}"):
        PriorRun.read(folder)


def test_a_run_without_a_posterior_is_refused_with_the_reason(folder, tmp_path):
    (folder / POSTERIOR).unlink()
    with pytest.raises(RecordingError, match="create it with: equipoise estimate"):
        PriorRun.read(folder)
    (folder / "calibration.json").unlink()
    with pytest.raises(RecordingError, match="no result"):
        PriorRun.read(folder)
    header = folder / "run.json"
    header.write_text(header.read_text(encoding="utf-8").replace('"bayesian"', '"paper"'), encoding="utf-8")
    with pytest.raises(SettingsError, match="of the method 'paper'"):
        PriorRun.read(folder)
    for path, kind in ((tmp_path, "a folder"), (folder / "run.json", "a JSON file")):
        with pytest.raises(RecordingError, match=f"it is {kind}; name the run folder of a calibration"):
            PriorRun.read(path)


@pytest.mark.parametrize("verb", [["payload", "unitree_a1"], ["plan"], ["calibrate"]], ids=lambda verb: verb[0])
def test_a_run_that_is_not_there_ends_every_verb_alike(verb, tmp_path, capsys):
    assert main([*verb, "--prior-run", str(tmp_path / "nowhere")]) == RecordingError.exit_code
    assert "does not exist; name the run folder of a calibration" in capsys.readouterr().err


def test_another_robot_is_refused(two_jointed, earlier):
    with pytest.raises(SettingsError, match="of 'unitree_a1', with another model file"):
        BayesianMethod(prior_run=earlier).check(two_jointed, nominal_stance(two_jointed))


def test_settings_that_contradict_the_earlier_run_are_refused(earlier):
    with pytest.raises(SettingsError, match="but 'wide' in the prior run"):
        BayesianMethod(prior_run=earlier, leg_prior="narrow")
    with pytest.raises(SettingsError, match="cannot be combined with a prior run"):
        BayesianMethod(prior_run=earlier, rotate_halfway=True)


def test_a_plan_predicts_smaller_intervals(a1, earlier):
    plan = BayesianMethod(prior_run=earlier, duration=45).forecast(a1, nominal_stance(a1))
    assert plan.robot_time <= 45
    assert np.hypot(*plan.std[1:3]) < 0.85 * np.hypot(*plan.std_without_prior_run[1:3])
    assert plan.trials()[3][0] == "search, nominal"
    with_lifts = [bool(visit.lifts) for visit in plan.visits]
    assert with_lifts == sorted(with_lifts)  # feet are put back once for all moves
    with pytest.raises(SettingsError, match="lifts after the search; give"):
        BayesianMethod(prior_run=earlier, duration=20).forecast(a1, nominal_stance(a1))


# --- requirements


@pytest.mark.parametrize("words", ["checks,com_x", "checks,identified"])
def test_an_unmet_requirement_has_an_exit_code(folder, bayesian_run, words, capsys, monkeypatch):
    monkeypatch.setattr(RunFolder, "estimate", lambda *_: bayesian_run.result)
    met = bayesian_run.result.to_dict()["verdicts"]
    assert met["checks"]
    assert not met["identified"]  # 44 s, no scale
    well = all(met[word] for word in words.split(","))
    assert main(["estimate", str(folder), "--fail-unless", words, "--json", "--no-report"]) == (0 if well else UNMET)
    captured = capsys.readouterr()
    assert json.loads(captured.out)["verdicts"] == met
    assert ("requirement not met" in captured.err) == (not well)


def test_an_unknown_requirement_is_refused(folder, capsys):
    assert main(["estimate", str(folder), "--fail-unless", "indentified"]) == 2
    assert "did you mean 'identified'?" in capsys.readouterr().err


def test_the_budget_names_the_prior_run_as_a_source(later):
    (source,) = [
        source for source in later[2].uncertainty_budget if source.name.startswith("uncertainty of the prior run")
    ]
    assert 0.1 < source.shares[1] < 1
    np.testing.assert_allclose(sum(each.shares for each in later[2].uncertainty_budget), 1, atol=1e-6)
