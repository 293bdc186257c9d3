"""Payload in the log of a trot, against a prior run and against the model file."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from commands import fails
from foreign_logs import columns_of, write_csv

from equipoise import BayesianMethod, simulate
from equipoise.cli import main
from equipoise.errors import RecordingError, SettingsError
from equipoise.estimator.prior_runs.prior_run import PriorRun
from equipoise.lab.gaits.trot import trot
from equipoise.logs.joint_names import JointMap
from equipoise.logs.offline import estimate_log, estimate_segments, read_segments
from equipoise.logs.payload import measure_payload_in_log
from equipoise.logs.raw_log import Log

DURATION = 11.0  # [s]


@pytest.fixture(scope="module")
def trotted(a1):
    """Log of the robot of `bayesian_run`, without its payload, while it trots."""
    with simulate(a1, "realistic", seed=4, noise_seed=204) as simulation:
        recording = trot(simulation.platform, a1, DURATION)
        return SimpleNamespace(recording=recording, truth=simulation.truth)


@pytest.fixture(scope="module")
def log(trotted):
    return Log(trotted.recording, JointMap(()), {}, ())


@pytest.fixture(scope="module")
def weighed_result(a1, bayesian_run):
    """Return the result of `bayesian_run` with the robot's true mass."""
    settings = replace(bayesian_run.settings, mass=bayesian_run.truth.composite.mass)
    return settings.estimate(a1, bayesian_run.recordings, bayesian_run.stance)


def prior_run_of(result):
    return PriorRun.of(result.evidence.posterior, result.settings)


def test_a_payload_that_was_removed_since_the_prior_run(a1, log, trotted, bayesian_run, weighed_result):
    method = BayesianMethod(prior_run=prior_run_of(weighed_result), mass=trotted.truth.composite.mass)
    found, _ = measure_payload_in_log(a1, log, method)
    change = found.change.with_truth(bayesian_run.truth, trotted.truth)
    assert found.answer == "removed"
    assert " since the prior run; " in found.message
    assert not any(one.missed for one in [*change.payload][:4])


@pytest.fixture(scope="module")
def bare(a1):
    """Log of a trot of the robot of `bayesian_run`, as it was in that run."""
    with simulate(a1, "realistic", seed=4, payload="1.5,0.05,-0.02,0.06", noise_seed=205, timestep=1e-3) as simulation:
        return Log(trot(simulation.platform, a1, DURATION, phase=2.0), JointMap(()), {}, ())


@pytest.mark.parametrize("weighed", [True, False])
def test_a_bare_log_replaces_the_scale(a1, log, bare, trotted, bayesian_run, weighed_result, weighed):
    true = bayesian_run.truth.composite.mass
    before = weighed_result if weighed else bayesian_run.result
    found, report = measure_payload_in_log(a1, log, BayesianMethod(prior_run=prior_run_of(before)), bare)
    (finding,) = (one.message for one in report.findings if one.about == "bare log")
    assert "by the loads on its feet" in finding
    assert found.answer == "removed"
    payload = found.change.with_truth(bayesian_run.truth, trotted.truth).payload
    assert not any(one.missed for one in [*payload][:4])
    # Its error is that of the prior run's mass as a fraction of the payload's, not of the robot's.
    assert payload.mass.value == pytest.approx(1.5 * before.composite.mass.value / true, abs=0.05)
    assert payload.mass.std < 0.06 + 1.5 * before.composite.mass.std / true


def test_a_bare_log_that_cannot_replace_the_scale_is_refused(a1, log, bare, weighed_result):
    method = BayesianMethod(prior_run=prior_run_of(weighed_result))
    silent = replace(bare, recording=replace(bare.recording, joints=replace(bare.recording.joints, torque=None)))
    with pytest.raises(RecordingError, match="the bare log has no joint torques"):
        measure_payload_in_log(a1, log, method, silent)
    with pytest.raises(RecordingError, match="the bare log has 4 s of usable walking; at least 8 s are needed"):
        measure_payload_in_log(a1, log, method, replace(bare, recording=bare.recording.between(0, 6)))
    with pytest.raises(RecordingError, match="another robot, or carries another payload"):
        measure_payload_in_log(a1, bare, method, log)
    standing = replace(bare, recording=bare.recording.between(0, 0.9))
    with pytest.raises(RecordingError, match="the bare log has 0 s of usable walking"):
        measure_payload_in_log(a1, log, method, standing)
    with pytest.raises(SettingsError, match="give a prior run, and no mass"):
        measure_payload_in_log(a1, log, replace(method, mass=14.0), bare)


def test_a_robot_like_that_in_the_bare_log_carries_nothing(a1, bare, bayesian_run):
    found, _ = measure_payload_in_log(a1, bare, BayesianMethod(prior_run=prior_run_of(bayesian_run.result)), bare)
    assert found.change.change.mass.lower < 0 < found.change.change.mass.upper
    assert found.answer in ("nothing", "unsure")


def test_without_a_prior_run_the_model_file_is_the_reference(a1, log, trotted):
    mass = trotted.truth.composite.mass
    found, _ = measure_payload_in_log(a1, log, BayesianMethod(mass=mass, mass_std=0.1))
    whole, file = found.result.composite, found.result.nominal.composite
    assert found.change.change.mass.value == pytest.approx(mass - file.mass, abs=0.1)
    np.testing.assert_allclose([one.value for one in found.change.change], whole.values - [one.model for one in whole])
    np.testing.assert_allclose([one.std for one in found.change.change], whole.stds, rtol=1e-3)
    assert "relative to the model file, whose errors count as payload" in found.message


def test_a_payload_is_the_difference_of_the_whole_robot_from_the_file(a1, log):
    found, _ = measure_payload_in_log(a1, log, BayesianMethod(mass=14.4, mass_std=0.05))  # as if 2 kg were there
    assert found.answer == "added"
    added = found.result.composite.parameters().vector - found.result.nominal.composite.vector
    np.testing.assert_allclose(found.change.payload.parameters().vector, added, atol=1e-9)
    assert "; cannot tell " in found.message
    assert found.message.endswith(" mm")
    assert "pass --mass" not in found.message


def test_a_log_without_torques_and_scale_cannot_tell(a1, log):
    silent = replace(log, recording=replace(log.recording, joints=replace(log.recording.joints, torque=None)))
    found, _ = measure_payload_in_log(a1, silent, BayesianMethod())
    assert found.answer in ("unsure", "moved")
    assert not found.verdicts["identified"]


def test_fewer_walks_are_spread_over_the_log(a1, log):
    walks = [one for one in estimate_log(a1, log).report.segments if one.kind == "walk" and one.used]
    assert len(walks) > 3
    report = estimate_segments(a1, read_segments(a1, log), BayesianMethod(), most_walks=2).report
    kept = [one for one in report.segments if one.kind == "walk" and one.used]
    assert [one.start for one in kept] == [walks[0].start, walks[-1].start]
    reasons = {one.reason_unused for one in report.segments if one.kind == "walk" and not one.used}
    assert f"2 of {len(walks)} pieces of walking suffice for this answer" in reasons


def test_the_command(trotted, tmp_path, capsys):
    file = write_csv(tmp_path / "trot.csv", columns_of(trotted.recording))
    command = ["payload", "unitree_a1", "--log", str(file), "--mass", "14.4"]
    assert main([*command, "--out", str(tmp_path / "answer.json")]) == 0
    assert " kg added at x y z = " in capsys.readouterr().out
    assert main([*command, "--json"]) == 0
    table = json.loads(capsys.readouterr().out)
    assert table == json.loads((tmp_path / "answer.json").read_text())
    assert (table["schema"], table["answer"]) == ("equipoise.payload/1", "added")
    assert any(segment["kind"] == "walk" for segment in table["log"]["segments"])
    assert "--log: nothing moves" in fails(capsys, 2, *command, "--duration", "30s")
    assert "--log: nothing moves" in fails(capsys, 2, *command, "--seed", "1")


def test_a_log_whose_columns_are_not_known_is_refused_with_a_proposal(tmp_path, capsys):
    path = tmp_path / "log.csv"
    path.write_text("first,second\n0,1\n1,2\n", encoding="utf-8")
    assert main(["payload", "unitree_a1", "--log", str(path)]) == 5
    printed = capsys.readouterr()
    assert printed.err.startswith("error: ")
    assert "add --columns columns.toml" in printed.err
    assert printed.out == ""


def test_flags_of_logs_need_a_log(capsys):
    assert "pass --log too" in fails(capsys, 2, "payload", "unitree_a1", "--from", "2s")
    assert "pass --log too" in fails(capsys, 2, "payload", "unitree_a1", "--bare-log", "bare.csv")
    assert "or the log of a walk: --log LOG" in fails(capsys, 2, "payload", "unitree_a1")
    alone = ["payload", "unitree_a1", "--log", "walk.csv", "--bare-log", "bare.csv"]
    assert "pass --prior-run RUN, and no --mass" in fails(capsys, 2, *alone)
    assert "does not exist" in fails(capsys, 5, "payload", "unitree_a1", "--log", "nothing.csv")
