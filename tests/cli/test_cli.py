"""Command line for users and scripts."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ET

import pytest
from commands import fails

from equipoise import RunFolder, load_robot
from equipoise import __main__ as entry
from equipoise.cli import VERBS, main
from equipoise.experiments.progress import Progress
from equipoise.terminal.results import TrialProgress

QUICK = [
    "--sim-preset",
    "ideal",
    "--method",
    "paper",
    "--quiet",
    "--no-report",
    "--tolerance",
    "0.02",
    "--excitation-duration",
    "1.0",
]
COMMAND = [sys.executable, "-m", "equipoise"]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Folder of a short calibration."""
    folder = tmp_path_factory.mktemp("runs") / "a1"
    assert main(["calibrate", *QUICK, "--out", str(folder), "--payload", "1,0.05,0.02,0.1", "--seed", "3"]) == 0
    return folder


def test_calibrate_saves_the_run(run):
    assert (run / "calibration.json").is_file()
    assert len(RunFolder.open(run).recordings()) >= 6


def test_json_is_one_object_with_the_stable_keys(run, capsys):
    assert main(["estimate", str(run), "--json"]) == 0
    captured = capsys.readouterr()
    table = json.loads(captured.out)
    assert {"schema", "robot", "method", "stance", "composite", "base", "trials", "truth", "errors"} <= set(table)
    assert len(table["stance"]["joint_position"]) == 12
    assert table["composite"]["mass"] is None
    assert table["composite"]["com_in_base"][2] is None
    assert table["composite"]["inertia"] is None
    assert table["truth"]["composite"]["mass"] == pytest.approx(13.458)
    assert captured.err == ""


def test_estimating_again_gives_the_same_result(run, capsys):
    main(["estimate", str(run), "--json"])
    again = json.loads(capsys.readouterr().out)
    assert again == json.loads((run / "calibration.json").read_text(encoding="utf-8"))


def test_estimating_needs_no_simulator(run):
    code = (
        "import sys; sys.modules['mujoco'] = None; from equipoise.cli import main; "
        f"sys.exit(main(['estimate', {str(run)!r}]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "CoM x [mm]" in done.stdout


def test_commanded_feet_give_another_estimate_from_the_same_recordings(run, capsys):
    main(["estimate", str(run), "--json", "--feet", "commanded"])
    commanded = json.loads(capsys.readouterr().out)
    measured = json.loads((run / "calibration.json").read_text(encoding="utf-8"))
    assert commanded["composite"]["com_in_base"] != measured["composite"]["com_in_base"]
    assert commanded["settings"]["feet"] == "commanded"


def test_calibrate_prints_json_and_nothing_else(tmp_path, capsys):
    assert main(["calibrate", *QUICK, "--json", "--out", str(tmp_path / "run")]) == 0
    assert json.loads(capsys.readouterr().out)["robot"] == "unitree_a1"


def test_the_table_shows_estimate_truth_and_error(run, capsys):
    main(["estimate", str(run)])
    printed = capsys.readouterr().out
    for word in ("parameter", "estimate", "truth", "error", "CoM x [mm]", "I_z (yaw) [kg m2]", "robot time"):
        assert word in printed


def test_robots_lists_the_catalogue(capsys):
    assert main(["robots", "--json"]) == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)["robots"]}
    assert rows["unitree_a1"]["mass"] == pytest.approx(12.458)
    assert rows["unitree_a1"]["legs"] == "4 x 3"
    assert {"a1", "go1", "go2", "b1", "laikago", "anymal_b", "anymal_c", "hyq", "solo8", "solo12"} <= set(rows)
    assert main(["robots"]) == 0
    printed = capsys.readouterr().out
    assert "unitree_a1" in printed
    assert "unitree_a1, a1: two model files of the Unitree A1" in printed


def test_audit_prints_the_ratio_of_composite_to_base(capsys):
    assert main(["audit", "unitree_a1"]) == 0
    assert "x the base's" in capsys.readouterr().out.replace("\n", " ")
    assert main(["audit", "unitree_a1", "--json"]) == 0
    table = json.loads(capsys.readouterr().out)
    assert table["ratio_composite_over_base"][0] > 5
    assert main(["audit", "unitree_a1", "--format", "json"]) == 0
    assert json.loads(capsys.readouterr().out) == table
    assert main(["audit", "unitree_a2", "--format", "json"]) == 3
    assert json.loads(capsys.readouterr().out)["error"]["exit_code"] == 3


def test_an_audit_with_an_error_exits_with_one(tmp_path, a1_urdf, capsys):
    root = ET.fromstring(a1_urdf)
    root.find("link[@name='trunk']/inertial/inertia").set("izz", "0.5")
    file = tmp_path / "robot.urdf"
    file.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
    assert main(["audit", str(file)]) == 1
    assert "error: trunk: " in capsys.readouterr().out


def test_names_outside_the_terminals_encoding_are_printed(tmp_path, a1_urdf):
    file = tmp_path / "ходок.urdf"
    file.write_text(a1_urdf, encoding="utf-8")
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run([*COMMAND, "audit", str(file)], capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    assert "\\u0445" in done.stdout


@pytest.mark.parametrize("verb", ["calibrate", "plan", "estimate", "robots", "audit"])
def test_every_verbs_help_shows_an_example_and_fits_its_lines(verb, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")
    assert main([verb, "--help"]) == 0
    shown = capsys.readouterr().out
    assert f"equipoise {verb}" in shown.split("Example:")[1]
    assert all(len(line) <= 80 for line in shown.splitlines() if not line.startswith(" "))


def test_every_verb_has_a_line_of_80_columns(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["--help"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert all(f"  {verb:<12}  {words}" in lines for verb, (_, words) in VERBS.items())
    assert "  lab           balance, emulate, monte-carlo, reproduce, validate" in lines


def test_a_group_of_verbs_lists_its_own(capsys):
    assert main(["lab"]) == 2
    bare = capsys.readouterr().out
    assert main(["lab", "--help"]) == 0
    assert capsys.readouterr().out == bare
    assert "\n  emulate       start an emulator" in bare
    assert fails(capsys, 2, "lab", "balence").startswith(
        "error: equipoise lab has no verb 'balence'; did you mean 'balance'?"
    )


# Bad input: one sentence, a stable exit code, no traceback.


def test_a_file_that_is_missing(capsys):
    assert "does not exist" in fails(capsys, 3, "calibrate", "no/such/robot.urdf")


def test_messages_wrap_at_a_terminal_alone(tmp_path, monkeypatch, capsys):
    name = f"{tmp_path}/{'a-long-name-' * 8}"
    whole = f"error: {name!r} does not exist; name the run folder of a calibration\n"
    monkeypatch.setenv("COLUMNS", "30")
    assert main(["compare", name, name]) == 5
    assert capsys.readouterr().err == whole
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    assert main(["compare", name, name]) == 5
    wrapped = capsys.readouterr().err
    assert wrapped.split() == whole.split()
    assert max(len(line) for line in wrapped.splitlines() if name not in line) <= 30
    assert f"\n{name!r}\n" in wrapped  # which can be copied
    assert (
        main(
            ["calibrate", "--method", "static", "--sim-preset", "ideal", "--no-report", "--out", str(tmp_path / "run")]
        )
        == 0
    )
    assert capsys.readouterr().err.startswith("unitree_a1 (default; for\nanother: equipoise calibrate\nROBOT), ")


def test_an_unknown_name_lists_the_valid_names(capsys):
    assert "known names are unitree_a1, a1" in fails(capsys, 3, "calibrate", "rex")


def test_a_file_that_is_not_xml(tmp_path, capsys):
    file = tmp_path / "robot.urdf"
    file.write_text("mass: 12", encoding="utf-8")
    assert "is not valid XML" in fails(capsys, 3, "audit", str(file))


def test_a_model_with_a_nan(tmp_path, a1_urdf, capsys):
    file = tmp_path / "robot.urdf"
    file.write_text(a1_urdf.replace('<mass value="4.713"/>', '<mass value="nan"/>'), encoding="utf-8")
    assert "every number must be finite" in fails(capsys, 3, "calibrate", str(file))


def test_a_payload_that_is_not_physical(capsys):
    message = fails(capsys, 2, "calibrate", "--payload", "1,0,0,0,0.001,0.001,0.01")
    assert "exceeds the sum of the others" in message
    assert "must be positive" in fails(capsys, 2, "calibrate", "--payload", "0,0,0,0")
    assert "is not MASS,X,Y,Z" in fails(capsys, 2, "calibrate", "--payload", "heavy")


def test_a_bracket_the_wrong_way_round(capsys):
    assert "wrong way round" in fails(
        capsys, 2, "calibrate", "--method", "paper", "--lower", "0.02", "--upper", "-0.02"
    )


def test_bounds_out_of_reach(tmp_path, capsys):
    message = fails(
        capsys, 4, "calibrate", "--method", "paper", "--upper", "0.4", "--quiet", "--out", str(tmp_path / "run")
    )
    assert "foot misses its place" in message or "tip over" in message


def test_a_stance_out_of_reach(capsys):
    assert "stance" in fails(capsys, 4, "calibrate", "--stance-height", "0.99")


@pytest.mark.parametrize(
    "flags",
    [
        ("--lower=-inf",), ("--upper", "nan"), ("--speed", "1000"), ("--speed", "1e-9"), ("--t-thres", "1e9"),
        ("--t-thres", "1e-9"), ("--tolerance", "1e-300"), ("--tolerance", "1"), ("--lift-height", "1e-6"),
        ("--lift-height", "0.3"), ("--excitation-frequency", "400"), ("--excitation-amplitude", "3"),
        ("--excitation-duration", "0.1"), ("--excitation-duration", "1e9"),
    ],
)  # fmt: skip
def test_absurd_settings_raise_before_a_run_begins(flags, tmp_path, capsys):
    fails(capsys, 2, "calibrate", "--method", "paper", *flags, "--out", str(tmp_path / "run"))
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["calibrat"], "equipoise has no verb 'calibrat'; did you mean 'calibrate'? 'equipoise --help' lists them"),
        (["calibrate", "--duration", "1 day"], "--duration '1 day' is not a time; give it as 60s, 2min or 1h"),
        (["calibrate", "--duration", "2h"], "duration is 7200 s; it must be above zero, up to 3600 s"),
        (["calibrate", "--duration", "1s"], "a duration of 1 s allows no lift after the search; give 28 s or more"),
        (
            ["calibrate", "--duration", "2"],
            "a duration of 2 s allows no lift after the search; give 28 s or more, or a duration in minutes, such as 2min",
        ),
        (["payload", "unitree_a1", "--mass-std", "1"], "mass_std is given without a mass; give both or neither"),
        (["calibrate", "--locked-joints", "foo=1"], "leg joint or does not exist; this robot has no others, so leave it out"),
        (["calibrate", "--seed", "-1"], "the seed is -1; it must be zero or more"),
        (["calibrate", "--noise-seed", "-1"], "the seed of the noise is -1; it must be zero or more"),
        (["lab", "balance", "--seed", "-1"], "the seed is -1; it must be zero or more"),
        (["calibrate", "--payload", "1500,0,0,0"], "a payload of 1500 kg is 120 times the mass of 'unitree_a1'"),
        (["calibrate", "--payload", "1.5,100,0,80"], "a payload 128 m from the base's origin is not on 'unitree_a1'"),
    ],
)  # fmt: skip
def test_invalid_arguments_raise_before_a_run_begins(words, message, tmp_path, capsys):
    out = ["--out", str(tmp_path / "run")] if len(words) > 1 else []
    assert main([*words, *out]) == 2
    (line,) = capsys.readouterr().err.splitlines()  # the settings of a run are not printed
    assert line.startswith("error: ")
    assert message in line
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--noise-seed", "abc"], "Error parsing --noise-seed: 'abc' is not a whole number"),
        (["--mass", "heavy"], "Error parsing --mass: 'heavy' is not a number"),
        (["--seed", "1.5"], "Error parsing --seed: '1.5' is not a whole number"),
    ],
)
def test_words_that_are_not_numbers_raise(words, message, capsys):
    assert main(["calibrate", *words]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("external_forse = 0.1", "'external_forse' is not a parameter; did you mean 'external_force'?"),
        ("external_force = 'much'", "the prior of external_force is 'much'; it must be a number"),
        (
            "external_force = -1",
            "the prior of external_force is -1.0; it must be a finite number above zero, or zero to fix the parameter",
        ),
        ("pull", "cannot read priors from"),
        (None, "cannot read priors from"),
    ],
)
def test_an_invalid_file_of_priors_raises(text, message, tmp_path, capsys):
    file = tmp_path / "priors.toml"
    if text is not None:
        file.write_text(text, encoding="utf-8")
    assert message in fails(capsys, 2, "plan", "--priors", str(file))


def test_the_plan_uses_cable_legs_and_priors(tmp_path, capsys):
    def std(*flags):
        assert main(["plan", "--duration", "40s", "--json", *flags]) == 0
        return json.loads(capsys.readouterr().out)["predicted_std"]

    file = tmp_path / "priors.toml"
    file.write_text("external_force = 0.0\nhanging_load = 0.0\ntether_stiffness = 0.0", encoding="utf-8")
    usual, loose = std(), std("--cable", "none")
    assert loose["com_x"] < 0.95 * usual["com_x"]
    assert std("--priors", str(file)) == loose
    assert std("--leg-prior", "narrow")["com_z"] < 0.95 * usual["com_z"]
    assert main(["plan", "--cable", "long"]) == 2


def test_a_run_of_another_robot_is_refused(run, tmp_path, a1_urdf, capsys):
    file = tmp_path / "other.urdf"
    file.write_text(a1_urdf, encoding="utf-8")
    name = load_robot(file).name
    assert fails(capsys, 2, "estimate", str(run), "--robot", str(file)) == (
        f"error: the run {str(run)!r} is of the robot 'unitree_a1', but --robot is {name!r}; leave out --robot"
    )


def test_a_model_that_was_changed_after_the_run_is_refused(run, tmp_path, capsys):
    copy = tmp_path / "copy"
    shutil.copytree(run, copy)
    model = copy / "model.xml"
    model.write_text(model.read_text(encoding="utf-8").replace("4.713", "9.713"), encoding="utf-8")
    assert "was changed after the recording" in fails(capsys, 5, "estimate", str(copy))


def test_a_wrong_flag_is_an_object_too_with_json(capsys):
    assert main(["calibrate", "--json", "--bogus"]) == 2
    assert json.loads(capsys.readouterr().out)["error"]["exit_code"] == 2


def test_a_seed_that_is_not_a_number(capsys):
    assert main(["calibrate", "--seed", "x"]) == 2
    assert "seed" in capsys.readouterr().err


def test_a_flag_that_does_not_exist(capsys):
    assert main(["calibrate", "--colour"]) == 2
    message = capsys.readouterr().err
    assert "--colour" in message
    assert "equipoise calibrate --help" in message, "the help that has the flags, not the list of verbs"


def test_an_output_folder_that_holds_another_run(run, capsys):
    assert "holds another run" in fails(capsys, 6, "calibrate", "--out", str(run), "--quiet")


def test_an_output_folder_that_cannot_be_written(tmp_path, capsys):
    (tmp_path / "file").write_text("", encoding="utf-8")
    assert "cannot write" in fails(capsys, 6, "calibrate", "--out", str(tmp_path / "file" / "run"), "--quiet")


def test_a_folder_that_is_not_a_run(tmp_path, capsys):
    assert "is a folder without run.json; name the run folder of a calibration" in fails(
        capsys, 5, "estimate", str(tmp_path)
    )


def test_an_error_is_an_object_too_with_json(capsys):
    assert main(["audit", "nobody", "--json"]) == 3
    table = json.loads(capsys.readouterr().out)
    assert table["error"]["type"] == "ModelError"
    assert table["error"]["exit_code"] == 3


def test_debug_shows_the_traceback():
    done = subprocess.run([*COMMAND, "audit", "nobody", "--debug"], capture_output=True, text=True, check=False)
    assert "Traceback" in done.stderr
    assert done.returncode == 3


def test_a_description_file_that_is_missing_or_wrong(tmp_path, capsys):
    assert "does not exist" in fails(capsys, 2, "audit", "unitree_a1", "--robot-config", str(tmp_path / "no.toml"))
    file = tmp_path / "robot.toml"
    file.write_text("feet = 4", encoding="utf-8")
    assert "unknown key 'feet'" in fails(capsys, 2, "audit", "unitree_a1", "--robot-config", str(file))


def test_flags_of_a_robot_description_are_used(capsys):
    main(["audit", "unitree_a1", "--json", "--stance-height", "0.7"])
    assert json.loads(capsys.readouterr().out)["stance"]["hip_height"] == pytest.approx(0.7 * 0.4 + 0.02)


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_ctrl_c_keeps_the_completed_trials(tmp_path):
    folder = tmp_path / "run"
    process = subprocess.Popen(
        [*COMMAND, "calibrate", "--method", "paper", "--tolerance", "0.0002", "--t-thres", "10", "--out", str(folder)],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
    )
    seen = []
    for line in process.stderr:
        seen.append(line)
        if line.startswith("[4 of "):
            log = folder / "recording_0.mcap"
            size = log.stat().st_size
            while log.stat().st_size == size:
                time.sleep(0.002)
            process.send_signal(signal.SIGINT)
            break
    rest = process.communicate(timeout=30)[1]
    assert process.returncode == 130
    assert "Traceback" not in rest
    assert f"saved in {folder}" in rest
    assert f"resume: equipoise calibrate --resume {folder}" in rest
    log = RunFolder.open(folder).read()
    assert log.closed
    assert len(log.recordings) == 3
    assert log.unfinished.broken
    assert not list(folder.glob("*.partial"))
    again = subprocess.run([*COMMAND, "estimate", str(folder)], capture_output=True, text=True, check=False)
    assert again.returncode == 5
    assert "no complete search on" in again.stderr


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_ctrl_c_while_the_page_is_written_prints_the_command_for_it(tmp_path):
    folder = tmp_path / "run"
    process = subprocess.Popen(
        [*COMMAND, "calibrate", "--method", "paper", "--out", str(folder), "--quiet"], stderr=subprocess.PIPE, text=True
    )
    while not (folder / "calibration.json").exists():
        assert process.poll() is None
        time.sleep(0.002)
    process.send_signal(signal.SIGINT)
    printed = process.communicate(timeout=30)[1]
    assert process.returncode == 130
    assert not (folder / "report.html").exists()
    resume = ["calibrate", "--resume", str(folder)]
    assert f"resume: equipoise {' '.join(resume)}\n" in printed
    assert main([*resume]) == 0
    assert (folder / "report.html").exists()


# What somebody sees who does not know the verbs.


def test_without_a_verb_all_verbs_are_listed(capsys):
    assert main([]) == 2
    bare = capsys.readouterr().out
    assert main(["--help"]) == 0
    assert capsys.readouterr().out == bare
    for verb in VERBS:
        assert f"\n  {verb} " in bare


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_help_debug_quiet_and_json(verb, capsys):
    assert main([verb, "--help"]) == 0
    shown = capsys.readouterr().out
    assert "{None}" not in shown
    assert "(default: True)" not in shown
    assert "--json" in shown
    if verb not in ("robots", "platforms"):  # they print no progress
        assert "--debug" in shown
        assert "--quiet" in shown


def test_a_mistyped_name_gets_a_suggestion(capsys):
    assert "did you mean 'go2'? known names are" in fails(capsys, 3, "calibrate", "Go3")


def test_quiet_silences_warnings_about_the_model(capsys, tmp_path, a1_urdf):
    file = tmp_path / "robot.urdf"
    file.write_text(re.sub(r"<sphere[^>]*/>", '<mesh filename="foot.stl"/>', a1_urdf), encoding="utf-8")
    assert main(["plan", str(file), "--json"]) == 0
    assert "warning: " in capsys.readouterr().err
    assert main(["plan", str(file), "--json", "--quiet"]) == 0
    assert capsys.readouterr().err == ""


def test_calibrate_prints_its_settings_first(tmp_path, capsys):
    assert main(["calibrate", "--method", "static", "--out", str(tmp_path / "run")]) == 0
    message = capsys.readouterr().err.splitlines()[0]
    assert message.startswith(
        "unitree_a1 (default; for another: equipoise calibrate ROBOT), simulated in mujoco, preset realistic, method static"
    )


def test_a_total_that_may_change_is_an_approximation(capsys):
    with TrialProgress(quiet=False) as progress:
        progress.update(Progress("search on FL_RR", 4, 46))
    assert capsys.readouterr().err == "[5 of about 46] search on FL_RR\n"


def test_a_log_is_recorded_in_json(tmp_path, capsys):
    out = tmp_path / "log.mcap"
    assert main(["record", "--duration", "0.5s", "--out", str(out), "--json"]) == 0
    table = json.loads(capsys.readouterr().out)
    assert table["file"] == str(out)
    assert table["joint_samples"] > 200


def test_a_second_ctrl_c_leaves_no_traceback(monkeypatch):
    def interrupted():
        raise KeyboardInterrupt

    monkeypatch.setattr(entry, "main", interrupted)
    before = signal.getsignal(signal.SIGINT)
    try:
        assert entry.run() == 130
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)
