"""User interface of the Bayesian method: result, terminal, plan."""

import json
from dataclasses import replace

import numpy as np
import pytest

from equipoise import BayesianMethod, Calibration, calibrate, estimate, simulate
from equipoise.bayesian import routine as bayesian_routine
from equipoise.bayesian.plan import make_plan
from equipoise.bayesian.routine import BayesianRoutine
from equipoise.cli import main
from equipoise.cli.setting_flags import seconds
from equipoise.errors import RecordingError, SettingsError
from equipoise.estimator.unknowns import Priors
from equipoise.recording.trials import LiftTrial, PostureTrial
from equipoise.result.statistics import verdict_of
from equipoise.robot.inertial import COMPONENTS
from equipoise.terminal.results import print_calibration


def test_every_parameter_has_an_interval_a_covariance_and_a_verdict(bayesian_run):
    result = bayesian_run.result
    for body in ("composite", "base", "stance_effective"):
        found = getattr(result, body)
        assert tuple(quantity.name for quantity in found) == COMPONENTS
        assert np.linalg.eigvalsh(found.covariance).min() > -1e-12
        for variance, quantity in zip(np.diag(found.covariance), found, strict=True):
            assert quantity.std == pytest.approx(np.sqrt(variance))
            assert quantity.upper - quantity.lower == pytest.approx(2 * 1.96 * quantity.std)
            assert quantity.verdict in ("identified", "weak", "not identified")


def test_the_json_form_comes_back_whole(bayesian_run, tmp_path):
    bayesian_run.result.save(tmp_path / "a1.json")
    assert Calibration.load(tmp_path / "a1.json").to_dict() == bayesian_run.result.to_dict()


def test_the_result_gives_a_pinocchio_model_with_the_base_found(bayesian_run):
    model = bayesian_run.result.to_pinocchio()
    assert model.inertias[1].mass == pytest.approx(bayesian_run.result.base.mass.value)


def test_a_replan_without_lifts_is_ignored_while_lifts_are_too_few(a1, monkeypatch):
    """Stance motions may add more information per second, but are not sufficient alone."""
    recordings, replanned = [], []

    def replan(routine, posterior, done):
        replanned.append(len(done))
        candidates = routine._candidates()
        return make_plan(candidates, 1.0, known=np.eye(candidates.unknowns.size))

    monkeypatch.setattr(BayesianRoutine, "_replan", replan)
    monkeypatch.setattr(bayesian_routine, "_REPLAN_AT", 0.1)
    settings = BayesianMethod(duration=35, excitation=False)
    with simulate(a1, "realistic") as simulation:
        assert calibrate(simulation.platform, a1, settings, keep=recordings.append).trustworthy
    assert replanned[0] < 4
    searched = 4
    assert sum(isinstance(recording.trial, LiftTrial) for recording in recordings) >= searched + 4


def test_repeated_estimates_are_equal(a1, bayesian_run):
    again = estimate(a1, bayesian_run.recordings, bayesian_run.settings)
    assert again.composite.to_dict() == bayesian_run.result.composite.to_dict()


def test_recordings_of_another_method_are_rejected(a1, bayesian_run):
    moves = [recording for recording in bayesian_run.recordings if isinstance(recording.trial, PostureTrial)]
    with pytest.raises(RecordingError, match="no lift trial can be used"):
        estimate(a1, moves)


def test_a_failed_check_is_printed_before_the_numbers(bayesian_run, a1, capsys):
    # Twice the mass: torque gains of 1.3 are plausible, so a smaller error would pass.
    heavy = BayesianMethod(duration=40, mass=2 * a1.mass, mass_std=0.01, excitation=False)
    result = estimate(a1, bayesian_run.recordings, heavy)
    assert not result.trustworthy
    print_calibration(result, [])
    shown = capsys.readouterr().out
    assert shown.index("check failed") < shown.index("CoM x")
    for name in ("composite", "base", "stance_effective"):
        found, well = (getattr(of, name) for of in (result, bayesian_run.result))
        assert "doubtful" in {quantity.verdict for quantity in found} <= {"doubtful", "not identified"}
        assert not any(quantity.verdict == "doubtful" for quantity in well)


# --- prior choices of the user


@pytest.mark.parametrize(("cable", "factor"), [("none", 0.0), ("light", 1.0), ("heavy", 5.0)])
def test_the_cable_setting_scales_the_priors(cable, factor):
    usual = Priors()
    hanging, tether = {"none": (0.0, 0.0), "light": (1.0, 1.0), "heavy": (10.0, 2.0)}[cable]
    expected = Priors(
        external_force=factor * usual.external_force,
        hanging_load=hanging * usual.hanging_load,
        tether_stiffness=tether * usual.tether_stiffness,
    )
    assert BayesianMethod(cable=cable, rotate_halfway=True).combined_priors == expected
    custom = BayesianMethod(
        cable=cable, rotate_halfway=True, priors=Priors(external_force=0.3, backlash=0.1)
    ).combined_priors
    assert custom == replace(expected, external_force=factor * 0.3, backlash=0.1)


def test_a_carpet_widens_the_floor_priors():
    usual, soft = (
        BayesianMethod(rotate_halfway=True).combined_priors,
        BayesianMethod(rotate_halfway=True, surface="carpet").combined_priors,
    )
    wider = ("rolling_resistance", "foot_compliance", "floor_warp", "foothold_change")
    assert [getattr(soft, name) / getattr(usual, name) for name in wider] == pytest.approx([3.0] * 4)
    assert replace(soft, **{name: getattr(usual, name) for name in wider}) == usual


def test_a_narrow_leg_prior_fixes_all_but_leg_masses():
    fixed = ("leg_mass_common", "link_com", "link_com_common", "link_length", "link_length_common", "hip_position",
            "foot_radius_each", "foothold_change")  # fmt: skip
    assert BayesianMethod(leg_prior="narrow").combined_priors == Priors(leg_mass=0.03).holding(*fixed)
    for narrower in (0.01, 0.0):
        assert BayesianMethod(leg_prior="narrow", priors=Priors(leg_mass=narrower)).combined_priors.leg_mass == narrower
    assert BayesianMethod(priors=Priors(leg_mass=0.2), rotate_halfway=True).combined_priors == Priors(leg_mass=0.2)


def test_assumptions_are_described():
    assert "a cable may pull with 0.2 N sideways and 0.2 N down" in BayesianMethod().assumptions[0]
    assert "a cable may pull with 1 N sideways and 2 N down" in BayesianMethod(cable="heavy").assumptions[0]
    assert (
        "with 0 N sideways and 0.4 N down"
        in BayesianMethod(priors=Priors(external_force=0.0, hanging_load=0.16)).assumptions[0]
    )
    cable, legs = BayesianMethod(cable="none").assumptions, BayesianMethod(leg_prior="narrow").assumptions
    assert (len(cable), len(legs)) == (1, 2)
    assert "no cable" in cable[0]
    assert "legs" in legs[1]
    assert "3%" in legs[1]
    assert BayesianMethod(cable="none", leg_prior="narrow").assumptions == (*cable, legs[1])


@pytest.mark.parametrize(
    ("field", "choices"),
    [("cable", "none or light or heavy"), ("leg_prior", "wide or narrow"), ("surface", "hard or carpet")],
)
def test_other_choices_are_rejected(field, choices):
    with pytest.raises(SettingsError, match=f"{field} is 'wooden'; it must be {choices}"):
        BayesianMethod(**{field: "wooden"})


def test_assumptions_reduce_the_std_and_are_printed(a1, bayesian_run, tmp_path, capsys):
    plain = bayesian_run.result
    narrow = replace(bayesian_run.settings, cable="none", leg_prior="narrow")
    result = estimate(a1, bayesian_run.recordings, narrow)
    assert (result.composite.com_in_base.stds < plain.composite.com_in_base.stds).all()
    assert not result.evidence.posterior.unknowns.estimates("external_force")
    assert plain.evidence.posterior.unknowns.estimates("external_force")
    assert plain.assumptions == bayesian_run.settings.assumptions
    assert result.assumptions == narrow.assumptions
    result.save(tmp_path / "a1.json")
    assert Calibration.load(tmp_path / "a1.json").assumptions == narrow.assumptions
    print_calibration(result, [])
    shown = " ".join(capsys.readouterr().out.split())
    assert all(f"assumed: {assumption}" in shown for assumption in narrow.assumptions)


def test_the_terminal_shows_truth_and_stages_when_asked(bayesian_run, capsys):
    print_calibration(bayesian_run.result.with_truth(bayesian_run.truth), [], verbose=True)
    shown = capsys.readouterr().out
    for words in (
        "95 % +-",
        "truth",
        "identified",
        "estimate: ",
        "with its fixed links",
        "weak: posterior std above one tenth of the model file's prior std",
    ):
        assert words in shown


@pytest.mark.parametrize(
    ("text", "expected"), [("60", 60), ("60s", 60), ("1.5min", 90), ("2m", 120), ("1h", 3600), (None, None)]
)
def test_durations_are_parsed(text, expected):
    assert seconds(text, "budget") == expected


@pytest.mark.parametrize("text", ["", "soon", "-5s", "1d"])
def test_an_invalid_duration_is_rejected(text):
    with pytest.raises(SettingsError, match="is not a time"):
        seconds(text, "budget")


def test_the_plan_is_printed_without_moving_anything(capsys):
    assert main(["plan", "unitree_a1", "--duration", "60s"]) == 0
    assert "Predicted" in capsys.readouterr().out
    assert main(["plan", "unitree_a1", "--duration", "60s", "--json"]) == 0
    table = json.loads(capsys.readouterr().out)
    assert table["robot_time"] <= 60
    assert set(table["predicted_std"]) == set(COMPONENTS)


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--method", "paper", "--duration", "60s"], "--duration belongs to --method bayesian"),
        (["--tolerance", "0.001"], "--tolerance belongs to --method paper"),
        (["--motor-stance", "belly"], "--motor-stance belongs to --parameters motors"),
        (["--method", "motors", "--parameters", "base,motors"], "--method motors estimates motors only"),
        (["--duration", "25s"], "a duration of 25 s allows no lift after the search; give"),
        (
            ["--mass-std", "0.1"],
            "mass_std is given without a mass; give both or neither",
        ),
    ],
)
def test_flags_of_another_method_are_rejected(flags, message, capsys, tmp_path):
    assert main(["calibrate", *flags, "--out", str(tmp_path / "run")]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_verdicts_compare_each_body_with_its_own_prior(bayesian_run):
    result, posterior = bayesian_run.result, bayesian_run.result.evidence.posterior
    for name, parameters in (
        ("composite", posterior.unknowns.robot_body),
        ("base", posterior.unknowns.base_body),
        ("stance_effective", posterior.unknowns.stance_effective_body),
    ):
        body, before = getattr(result, name), posterior.std_before(parameters)
        assert [one.verdict for one in body] == [*map(verdict_of, body.stds, before)], name
