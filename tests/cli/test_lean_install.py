"""Installation without simulator, Plotly and bag readers: results are computed, and missing packages are named."""

import subprocess
import sys

import pytest

from equipoise import PaperMethod, RunFolder, calibrate, simulate

LACKING = ("mujoco", "plotly", "rosbags")
CODE = "import sys; sys.modules |= dict.fromkeys({}); from equipoise.cli import main; sys.exit(main(sys.argv[1:]))"


@pytest.fixture(scope="module")
def run(tmp_path_factory, a1):
    path = tmp_path_factory.mktemp("runs") / "a1"
    with simulate(a1, "ideal") as simulation, RunFolder.create(path, a1, PaperMethod(), {}) as folder:
        folder.save(calibrate(simulation.platform, a1, PaperMethod(), folder.keep))
    return path


def lean(*words, lacking=LACKING):
    command = [sys.executable, "-c", CODE.format(repr(lacking)), *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_a_run_is_estimated_and_its_page_left_out(run):
    done = lean("estimate", run)
    assert done.returncode == 0, done.stderr
    assert "CoM x [mm]" in done.stdout
    assert done.stderr == "warning: reports need Plotly: pip install 'equipoise[report]'\n"
    assert "report.html" not in done.stdout


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("calibrate", "--out", "{}/new"), "simulation needs MuJoCo: pip install 'equipoise[simulation]'"),
        (("report", "{}"), "reports need Plotly: pip install 'equipoise[report]'"),
        (
            ("estimate", "{}/recording_0.mcap", "--robot", "unitree_a1"),
            "bags need rosbags: pip install 'equipoise[logs]'",
        ),
        (("lab", "validate", "{}"), "reports need Plotly: pip install 'equipoise[report]'"),
        (("lab", "monte-carlo", "unitree_a1"), "reports need Plotly: pip install 'equipoise[report]'"),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else "",
)
def test_a_verb_names_the_missing_package(run, words, message):
    done = lean(*(word.format(run) for word in words))
    assert done.returncode == 7
    assert done.stderr.splitlines()[-1] == f"error: {message}"


def test_a_calibration_succeeds_without_its_page(tmp_path):
    out = tmp_path / "run"
    words = ("calibrate", "--method", "static", "--sim-preset", "ideal", "--out", out)
    done = lean(*words, lacking=("plotly",))
    assert done.returncode == 0, done.stderr
    assert RunFolder.open(out).complete
    printed = [line for line in done.stderr.splitlines() if line.startswith("warning: ")]
    assert printed == [
        f"warning: reports need Plotly: pip install 'equipoise[report]'; to retry: equipoise report {out} --out FILE"
    ]


@pytest.mark.parametrize("verb", ["monte-carlo", "reproduce", "balance", "validate", "emulate"])
def test_verbs_of_the_lab_have_help_without_their_packages(verb):
    assert lean("lab", verb, "--help", lacking=("pyarrow", "dask", "distributed", "cyclonedds")).returncode == 0


def test_plans_and_dry_runs_need_no_optional_package():
    assert lean("plan", "unitree_a1", "--duration", "40s").returncode == 0
