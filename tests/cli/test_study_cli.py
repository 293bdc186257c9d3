"""`equipoise lab monte-carlo` for users and scripts."""

import json

import pytest

from equipoise.cli import main

QUICK = ["lab", "monte-carlo", "--methods", "static", "--workers", "1", "--quiet"]


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Folder and output of a small study with varying error sources."""
    folder = tmp_path_factory.mktemp("studies") / "study"
    only = ["--vary-effects", "--only-effects", "joint_offset,torque_gain", "--seed", "2"]
    assert main([*QUICK, *only, "--trials", "30", "--out", str(folder)]) == 0
    return folder, only


def fails(capsys, code, *arguments):
    assert main(["lab", "monte-carlo", *arguments]) == code
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err
    (line,) = [line for line in captured.err.splitlines() if line.startswith("error: ")]
    assert captured.out == ""
    return line


def no_constants(name):
    raise AssertionError(f"{name} is no JSON")


def test_the_help_shows_an_example(capsys):
    assert main(["lab", "monte-carlo", "--help"]) == 0
    assert "equipoise lab monte-carlo" in capsys.readouterr().out.split("Example:")[1]


def test_page_and_tables_are_written(study):
    folder, _ = study
    page = (folder / "summary.html").read_text(encoding="utf-8")
    for words in ("Distribution of the CoM error", "static: planar error by source", "joint offset [mrad]"):
        assert words in page
    page = (folder / "summary.md").read_text(encoding="utf-8")
    for words in (
        "# Monte Carlo study of unitree_a1", "30 trials; noise realistic, only joint_offset, torque_gain",
        "\nstatic: 30 trials, within 5 mm ",
        "| planar CoM | mm | 30 |", "| mass | % | 30 |", "## static: planar error by source", "| joint offset | ",
        "| torque gain |", "| payload mass |",
    ):  # fmt: skip
        assert words in page
    assert "nan" not in page
    for line in page.splitlines():
        if line.startswith("|"):
            assert line.endswith("|")
    assert not (folder / "failures").exists()


def test_json_is_one_object_and_a_second_run_runs_nothing(study, capsys):
    folder, only = study
    parts = sorted((folder / "trials").iterdir())
    assert main([*QUICK, *only, "--trials", "30", "--out", str(folder), "--json", "--no-report"]) == 0
    captured = capsys.readouterr()
    table = json.loads(captured.out, parse_constant=no_constants)
    assert captured.err == ""
    assert sorted((folder / "trials").iterdir()) == parts
    assert json.loads((folder / "summary.json").read_text(encoding="utf-8")) == table
    assert table["schema"] == "equipoise.study-summary/1"
    assert table["study"]["only"] == ["joint_offset", "torque_gain"]
    (method,) = table["methods"]
    assert (method["method"], method["trials"], method["failures"]) == ("static", 30, {})
    assert method["within_5_mm"]["of"] == 30
    assert {"planar CoM", "mass", "com_x", "com_y"} <= {error["quantity"] for error in method["errors"]}
    assert [slope["source"] for slope in table["slopes"]] == ["size_joint_offset", "size_torque_gain", "payload_mass"]


def test_the_terminal_shows_the_numbers_of_the_page(study, capsys):
    folder, only = study
    assert main([*QUICK, *only, "--trials", "30", "--out", str(folder), "--no-report"]) == 0
    printed = capsys.readouterr().out
    for words in ("static: 30 trials, within 5 mm", "planar", "static: planar error by source", "saved: "):
        assert words in printed


def test_fewer_trials_give_a_summary_of_those(study, capsys):
    folder, only = study
    assert main([*QUICK, *only, "--trials", "3", "--out", str(folder), "--json", "--no-report"]) == 0
    assert json.loads(capsys.readouterr().out)["methods"][0]["trials"] == 3


def test_a_folder_of_another_study(study, capsys):
    folder, only = study
    message = fails(capsys, 2, "--methods", "static", *only[:-1], "3", "--trials", "30", "--out", str(folder))
    assert "contains another study (it differs in seed)" in message


def test_a_study_of_failures_prints_the_reason(tmp_path, capsys):
    folder = tmp_path / "study"
    assert main([*QUICK, "--payload", "20,0.5,0,0.3", "--trials", "2", "--out", str(folder)]) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    assert "failed: 2 FallError" in captured.out
    assert "FallError, the first in trial 0: 'unitree_a1' fell over" in captured.out
    page = (folder / "summary.md").read_text(encoding="utf-8")
    assert "- FallError, the first in trial 0: 'unitree_a1' fell over" in page
    assert "nan" not in page
    assert "FallError, the first in trial 0" in (folder / "summary.html").read_text(encoding="utf-8")
    assert main([*QUICK, "--payload", "20,0.5,0,0.3", "--trials", "2", "--out", str(folder), "--json"]) == 0
    table = json.loads(capsys.readouterr().out, parse_constant=no_constants)
    assert table["methods"][0]["robot_time"] is None
    assert sorted(path.name for path in (folder / "failures").iterdir()) == [
        "trial-000000-static",
        "trial-000001-static",
    ]


@pytest.mark.parametrize(
    ("code", "flags", "words"),
    [
        (2, ["--methods", "magic"], "method 'magic' is unknown; it must be one of bayesian, paper, motors"),
        (2, ["--methods", ","], "a study needs at least one method"),
        (2, ["--only-effects", "gremlins"], "'gremlins' is not an error source; use encoder_noise"),
        (2, ["--executor", "dask"], "--executor dask needs --scheduler tcp://HOST:PORT"),
        (2, ["--scheduler", "tcp://127.0.0.1:1"], "--executor dask needs --scheduler tcp://HOST:PORT"),
        (2, ["--executor", "dask", "--scheduler", "127.0.0.1:8786"], "it must be like tcp://"),
        (3, ["rex"], "no robot is called 'rex'"),
        (3, ["no/such.urdf"], "does not exist"),
        (2, ["--trials", "0"], "the number of trials is 0"),
        (2, ["--trials", "-5"], "the number of trials is -5"),
        (2, ["--workers", "0"], "the number of workers is 0"),
        (2, ["--timestep", "0"], "the time step is 0 s"),
        (2, ["--timestep", "0.0003"], "whole multiple of it"),
        (2, ["--timestep", "0.002"], "contacts of the feet need"),
        (2, ["--payload", "heavy"], "MASS,X,Y,Z"),
        (2, ["--methods", "bayesian", "--duration", "soon"], "give it as 60s, 2min or 1h"),
        (2, ["--duration", "60s"], "--duration belongs to --method bayesian; this is --methods paper"),
        (2, ["--tolerance", "0.9"], "leaves nothing to search"),
    ],
)
def test_wrong_flags_raise_one_clear_error_and_leave_no_folder(code, flags, words, tmp_path, capsys):
    if "dask" in flags:
        pytest.importorskip("distributed")
    assert words in fails(capsys, code, *flags, "--out", str(tmp_path / "study"))
    assert not (tmp_path / "study").exists()


@pytest.mark.parametrize(
    "flags", [["--colour"], ["--trials", "many"], ["--sim-preset", "loud"], ["--executor", "cloud"]]
)
def test_flags_that_do_not_exist(flags, capsys):
    assert main(["lab", "monte-carlo", *flags, "--json"]) == 2
    assert json.loads(capsys.readouterr().out)["error"]["exit_code"] == 2


def test_an_error_is_an_object_too_with_json(tmp_path, capsys):
    assert main(["lab", "monte-carlo", "rex", "--json", "--out", str(tmp_path / "study")]) == 3
    assert json.loads(capsys.readouterr().out)["error"]["type"] == "ModelError"
