"""Methods of other packages: they work in every verb, and a broken one does not affect others."""

import json
import shutil
from pathlib import Path

import pytest

from equipoise import Calibration, RunFolder, load_robot, nominal_stance
from equipoise.cli import main
from equipoise.errors import MissingDependencyError
from equipoise.method.table import METHODS, method_named
from equipoise.view.convergence import estimates

OUTSIDE = Path(__file__).parent / "outside"
QUICK = ["--method", "hefty", "--seed", "2", "--pause-time", "0.5s", "--pause-count", "3"]


@pytest.fixture(scope="module", autouse=True)
def installed():
    """Make the package importable in this process and its children."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(OUTSIDE))
        patch.setenv("PYTHONPATH", str(OUTSIDE), prepend=":")
        METHODS.__dict__.pop("_added", None)
        yield
    METHODS.__dict__.pop("_added", None)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Run of the method by the command line, with its report and pictures."""
    folder = tmp_path_factory.mktemp("runs") / "run"
    assert main(["calibrate", *QUICK, "--payload", "2,0,0,0.08", "--quiet", "--out", str(folder)]) == 0
    return folder


def test_a_run_has_settings_report_and_result(run, a1):
    method = RunFolder.open(run).method()
    assert (method.name, method.pauses.time, method.pauses.count) == ("hefty", 0.5, 3)
    result = Calibration.load(run / "calibration.json")
    assert result.method == "hefty"
    assert result.composite.mass.value == pytest.approx(a1.mass + 2, rel=0.1)
    assert len(result.trials) == 3
    assert "hefty" in (run / "report.html").read_text(encoding="utf-8")


def test_it_estimates_its_declared_parameters(run):
    found = Calibration.load(run / "calibration.json").composite
    assert {quantity.name for quantity in found if quantity.value is not None} == set(method_named("hefty").estimates)


def test_its_result_is_printed(run, capsys):
    assert main(["estimate", str(run), "--no-report"]) == 0
    printed = capsys.readouterr().out
    assert "method hefty" in printed
    mass = Calibration.load(run / "calibration.json").composite.mass.value
    assert f"{mass:.3f}" in printed
    assert "Iyy [kg m2]" in printed
    assert "Not estimated" not in printed


def test_it_is_estimated_again_with_its_own_flag(run, capsys):
    assert main(["estimate", str(run), "--average", "last", "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again["settings"]["average"] == "last"
    assert again["composite"]["mass"] != Calibration.load(run / "calibration.json").composite.mass.value
    assert main(["estimate", str(run), "--mass", "12"]) == 2
    assert "--mass belongs to --method bayesian; this is --method hefty" in capsys.readouterr().err


def test_an_interrupted_run_is_resumed(run, tmp_path, capsys):
    cut = tmp_path / "cut"
    shutil.copytree(run, cut)
    for name in ("calibration.json", "metadata.yaml"):
        (cut / name).unlink()
    log = (cut / "recording_0.mcap").read_bytes()
    (cut / "recording_0.mcap").write_bytes(log[: len(log) // 2])
    assert main(["calibrate", "--resume", str(cut), "--quiet", "--no-report", "--json"]) == 0
    assert (
        json.loads(capsys.readouterr().out)["composite"]
        == Calibration.load(run / "calibration.json").composite.to_dict()
    )


def test_its_plan_is_its_rehearsal(capsys):
    assert main(["plan", *QUICK[:2], "--pause-count", "5"]) == 0
    assert "stands still 5 times" in " ".join(capsys.readouterr().out.split())
    assert main(["calibrate", *QUICK, "--dry-run", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["method"] == "hefty"


def test_a_study_includes_it(tmp_path, capsys):
    flags = ["--methods", "hefty,static", "--pause-count", "1", "--trials", "2", "--workers", "1"]
    assert main(["lab", "monte-carlo", *flags, "--out", str(tmp_path / "study"), "--json"]) == 0
    methods = json.loads(capsys.readouterr().out)["methods"]
    assert {row["method"]: row["failures"] for row in methods} == {"hefty": {}, "static": {}}
    (hefty,) = (row for row in methods if row["method"] == "hefty")
    assert "Iyy" in {error["quantity"] for error in hefty["errors"]}


def shown_estimates(folder):
    """Return the estimates that the view shows of a run."""
    opened = RunFolder.open(folder)
    robot, method = opened.robot(), opened.method()
    coming = estimates(robot, nominal_stance(robot), method, list(opened.recordings()))
    return [estimate for estimate, _ in iter(coming.__next__, None)]


def test_its_run_is_shown_with_its_own_estimates(run, a1):
    assert RunFolder.open(run).method().expected_trials(nominal_stance(a1)) == 3
    assert shown_estimates(run)[2].half_width[2] == 0.01


def test_a_method_without_estimates_after_each_trial_is_not_shown_as_another(tmp_path):
    quiet = ["--quiet", "--no-report"]
    assert main(["calibrate", "--method", "static", *quiet, "--out", str(tmp_path / "run")]) == 0
    assert shown_estimates(tmp_path / "run") == []


def test_its_result_is_exported_and_compared(run, tmp_path):
    assert main(["export", str(run), "--to", "urdf", "--out", str(tmp_path / "robot.urdf"), "--quiet"]) == 0
    found = Calibration.load(run / "calibration.json").composite.mass.value
    assert load_robot(tmp_path / "robot.urdf").mass == pytest.approx(found, abs=1e-3)
    copy = tmp_path / "copy"
    shutil.copytree(run, copy)
    assert main(["report", str(run), str(copy), "--out", str(tmp_path / "both.html"), "--quiet"]) == 0


def test_help_lists_it_and_the_broken_one(capsys):
    assert main(["calibrate", "--method", "hefty", "--help"]) == 0
    shown = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "hefty: stands still now and then, and weighs itself." in shown
    assert "broken: cannot be used here" in shown
    assert "--pause-time TIME Time of each stand [s]; default 1.5 s." in shown
    assert "--duration" not in shown


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("broken", "method 'broken' of the package hefty 1.0 cannot be used: 'hefty.not_there:Broken' fails"),
        ("nothing", "method 'nothing' of the package hefty 1.0 cannot be used: 'hefty:stand' is of type function"),
    ],
)
def test_a_method_that_cannot_be_used_is_rejected_by_name(name, words, capsys):
    with pytest.raises(MissingDependencyError) as caught:
        method_named(name)
    assert str(caught.value).startswith(words)
    assert main(["calibrate", "--method", name]) == 7
    assert words in capsys.readouterr().err
    assert main(["plan", "--duration", "60s", "--json"]) == 0
