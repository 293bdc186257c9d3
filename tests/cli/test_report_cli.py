"""`equipoise report`, and the pages that other verbs write."""

import dataclasses
import json
import shutil

import pytest

from equipoise.cli import main
from equipoise.result.body import Body
from equipoise.result.calibration import Calibration

QUICK = ["calibrate", "--method", "static", "--quiet"]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "one"
    assert main([*QUICK, "--out", str(folder)]) == 0
    return folder


@pytest.fixture
def copy(run, tmp_path):
    """Copy of a run."""
    return shutil.copytree(run, tmp_path / "copy")


def fails(capsys, code, *arguments):
    assert main(["report", *map(str, arguments)]) == code
    captured = capsys.readouterr()
    (line,) = [line for line in captured.err.splitlines() if line.startswith("error: ")]
    return line


def test_calibrate_writes_the_page_and_prints_the_next_commands(tmp_path, capsys):
    folder = tmp_path / "run"
    assert main([*QUICK, "--out", str(folder)]) == 0
    printed = capsys.readouterr().out
    assert (folder / "report.html").stat().st_size > 1e6
    assert f"see {folder / 'report.html'}\nestimate again: equipoise estimate {folder}\n" in printed
    assert "export with" not in printed  # without an inertia


def test_calibrate_writes_no_page_with_no_report(tmp_path, capsys):
    folder = tmp_path / "run"
    assert main([*QUICK, "--no-report", "--out", str(folder)]) == 0
    assert not (folder / "report.html").exists()
    assert "see " not in capsys.readouterr().out


def test_estimate_writes_the_page_again(copy, capsys):
    (copy / "report.html").unlink()
    assert main(["estimate", str(copy), "--no-report"]) == 0
    assert not (copy / "report.html").exists()
    assert main(["estimate", str(copy)]) == 0
    assert (copy / "report.html").exists()
    assert f"see {copy / 'report.html'}" in capsys.readouterr().out


def test_an_estimate_with_other_settings_keeps_the_result_of_the_run(tmp_path, capsys):
    run, out, other = tmp_path / "run", tmp_path / "found.json", ["--feet", "commanded"]
    quick = ["--method", "paper", "--tolerance", "0.02", "--excitation-duration", "1.0", "--quiet"]
    assert main(["calibrate", *quick, "--no-report", "--out", str(run)]) == 0
    own = (run / "calibration.json").read_text(encoding="utf-8")
    capsys.readouterr()
    assert main(["estimate", str(run), *other]) == 0
    shown = capsys.readouterr().out
    assert f"not saved, and different from {run / 'calibration.json'}" in shown
    assert "export with" not in shown
    assert not (run / "report.html").exists()
    assert main(["estimate", str(run), *other, "--out", str(out)]) == 0
    assert f"saved: {out}, {tmp_path / 'found.html'}\n" in capsys.readouterr().out
    assert json.loads(out.read_text(encoding="utf-8"))["settings"]["feet"] == "commanded"
    assert (run / "calibration.json").read_text(encoding="utf-8") == own
    assert main(["estimate", str(run), "--feet", "guessed"]) == 2
    (run / "calibration.json").unlink()
    capsys.readouterr()
    assert main(["estimate", str(run)]) == 0
    assert f"finish it: equipoise calibrate --resume {run}" in capsys.readouterr().out


@pytest.mark.parametrize("verb", [["estimate"], ["report"], ["calibrate", "--resume"]], ids=lambda verb: verb[0])
def test_a_cut_recording_keeps_the_page_of_the_result(verb, copy, capsys):
    whole = (copy / "recording_0.mcap").read_bytes()
    (copy / "recording_0.mcap").write_bytes(whole[: int(0.97 * len(whole))])
    (copy / "report.html").unlink()
    kept = (copy / "calibration.json").read_bytes()
    main([*verb, str(copy)])
    printed = capsys.readouterr()
    assert printed.err.count("ends in the middle: it was cut, and may lack motions") == 1
    assert (copy / "calibration.json").read_bytes() == kept
    assert (copy / "report.html").exists() == (verb != ["estimate"])


def test_estimate_prints_numbers_if_the_page_cannot_be_written(copy, capsys):
    (copy / "report.html").unlink()
    (copy / "report.html").mkdir()
    (copy / "report.html" / "report.html").mkdir()
    assert main(["estimate", str(copy), "--json"]) == 0
    captured = capsys.readouterr()
    assert json.loads(captured.out)["method"] == "static"
    assert captured.err.startswith("warning: cannot write the report")


def test_report_writes_the_page_of_a_run_again(copy, capsys):
    (copy / "report.html").unlink()
    assert main(["report", str(copy)]) == 0
    assert capsys.readouterr().out == f"saved: {copy / 'report.html'}\n"
    assert (copy / "report.html").exists()


def test_several_runs_are_compared_on_one_page(run, copy, tmp_path, capsys):
    out = tmp_path / "both.html"
    assert main(["report", str(run), str(copy), "--out", str(out), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == {"schema": "equipoise.report/1", "report": str(out), "runs": [str(run), str(copy)]}
    assert "<h1>2 runs compared</h1>" in out.read_text(encoding="utf-8")


def test_a_comparison_is_written_to_the_working_folder(run, copy, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["report", str(run), str(copy), "--quiet"]) == 0
    assert capsys.readouterr().out == ""
    assert (tmp_path / "comparison.html").exists()
    page = tmp_path / "comparison.html"
    page.write_text("of other runs", encoding="utf-8")
    assert "'comparison.html' exists; to replace it, pass --out comparison.html" in fails(capsys, 6, run, copy)
    assert page.read_text(encoding="utf-8") == "of other runs"
    assert main(["report", str(run), str(copy), "--out", "comparison.html", "--quiet"]) == 0
    assert "2 runs compared" in page.read_text(encoding="utf-8")


def test_runs_without_a_common_parameter_are_not_compared(run, tmp_path, capsys):
    result = Calibration.load(run / "calibration.json")
    nothing = Body.partial(result.nominal.composite)
    motors = tmp_path / "motors.json"
    dataclasses.replace(result, method="motors", composite=nothing).save(motors)
    message = fails(capsys, 2, run, motors, "--out", tmp_path / "both.html")
    assert (
        "'motors.json' (method motors) has no mass, CoM or inertia in common with the other runs: leave it out"
        in message
    )
    assert not (tmp_path / "both.html").exists()


def test_the_page_of_a_json_result_is_in_its_folder(run, tmp_path, capsys):
    result = shutil.copy(run / "calibration.json", tmp_path / "found.json")
    assert main(["report", str(result)]) == 0
    assert capsys.readouterr().out == f"saved: {tmp_path / 'found.html'}\n"
    assert main(["report", str(result), str(run), "--out", str(tmp_path / "both.html")]) == 0


def test_errors_state_the_fix(run, tmp_path, capsys):
    assert "no run is given; name a run folder" in fails(capsys, 2)
    assert f"{str(run)!r} is named twice" in fails(capsys, 2, run, run)
    assert "does not exist; name the run folder of a calibration" in fails(capsys, 5, tmp_path / "nowhere")
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    assert "cannot write the report" in fails(capsys, 6, run, "--out", tmp_path / "file" / "page.html")


def test_the_help_shows_an_example(capsys):
    assert main(["report", "--help"]) == 0
    assert "equipoise report" in capsys.readouterr().out.split("Example:")[1]
