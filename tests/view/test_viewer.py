"""The viewer from the command line: live, in a browser, in a file, and after a crash."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
from rrd import read_rrd

from equipoise import BayesianMethod, RunFolder
from equipoise.cli import main
from equipoise.view.viewer import BROWSER, WINDOW, free_port, has_display, how_to_open, live_viewer

pytest.importorskip("rerun", reason="no rerun-sdk: the view was NOT TRIED")
EQUIPOISE = [sys.executable, "-m", "equipoise"]
QUICK = ["calibrate", "--method", "static", "--sim-preset", "realistic", "--no-report", "--quiet", "--json"]


@pytest.fixture(autouse=True)
def no_display(monkeypatch):
    """Remove the display, so that no test opens a window."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture(scope="module")
def run(a1, ideal_motions, tmp_path_factory):
    """Return the folder of a run of a move and a lift."""
    folder = RunFolder.create(tmp_path_factory.mktemp("runs") / "short", a1, BayesianMethod(), {})
    with folder:
        folder.keep(ideal_motions.move)
        folder.keep(ideal_motions.lift)
    return folder.path


@contextmanager
def served(*arguments):
    """Serve `equipoise view --browser`; yield the process and the address that it prints."""
    command = [*EQUIPOISE, "view", *map(str, arguments), "--browser", "--json"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        yield process, json.loads(process.stdout.readline())["url"]
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=20)


def waited_for(what, patience=20.0):
    end = time.monotonic() + patience
    while not what() and time.monotonic() < end:
        time.sleep(0.05)
    return what()


def answers(url):
    try:
        return urllib.request.urlopen(url, timeout=1).status == 200
    except (urllib.error.URLError, OSError):
        return False


def viewer_at(url):
    """Return the id of the process that serves a page."""
    port = re.match(r"http://127.0.0.1:(\d+)/", url)[1]
    found = subprocess.run(
        ["pgrep", "-f", f"rerun_cli/rerun .*--web-viewer-port {port}"], capture_output=True, text=True, check=True
    )
    return int(found.stdout)


def test_without_a_display_a_file_is_written_into_the_run_folder(run, capsys):
    assert not has_display()
    assert main(["view", str(run)]) == 0
    printed = capsys.readouterr()
    assert printed.out == f"saved: {run}/view.rrd\nopen it: rerun {run}/view.rrd\n"
    assert printed.err == f"view: recorded in {run}/view.rrd; an estimate is computed after each trial\n"
    assert {"/world/robot/FL_calf_joint", "/world/robot/com", "/tilt"} <= set(read_rrd(run / "view.rrd"))
    assert main(["view", str(run), "--json"]) == 0, "the file in the run folder is replaced"
    assert json.loads(capsys.readouterr().out) == {"schema": "equipoise.view/1", "file": f"{run}/view.rrd"}


def test_a_file_by_name_is_new(run, tmp_path, capsys):
    path = tmp_path / "run.rrd"
    assert main(["view", str(run), "--out", str(path), "--quiet"]) == 0
    assert capsys.readouterr().out == f"saved: {path}\nopen it: rerun {path}\n"
    assert main(["view", str(run), "--out", str(path)]) == 6
    assert capsys.readouterr().err == f"error: {str(path)!r} exists; name a new file with --out\n"


def test_a_log_of_another_program_is_recorded_in_the_working_folder(run, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["view", str(run / "recording_0.mcap"), "--robot", "unitree_a1", "--quiet"]) == 0
    assert capsys.readouterr().out == "saved: recording_0.rrd\nopen it: rerun recording_0.rrd\n"
    assert "/world/robot" in read_rrd(tmp_path / "recording_0.rrd")


def test_the_page_is_served_to_this_computer_until_ctrl_c(run):
    with served(run) as (process, url):
        assert waited_for(lambda: answers(url))
        data = int(re.search(r"127.0.0.1:(\d+)/proxy", url)[1])
        assert waited_for(lambda: connected("127.0.0.1", data))
        with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as probe:
            probe.connect(("192.0.2.1", 9))
            outside = probe.getsockname()[0]
        assert not connected(outside, data), "other computers cannot connect"
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=20) == 0
        assert process.stderr.read() == ""
    assert not answers(url)


def connected(host, port):
    try:
        socket.create_connection((host, port), timeout=1).close()
    except OSError:
        return False
    return True


def test_a_killed_viewer_leaves_the_calibration_alone(tmp_path):
    out, log = tmp_path / "run", tmp_path / "stderr"
    command = [*EQUIPOISE, *QUICK, "--method", "paper", "--out", str(out), "--view", "--browser"]
    with open(log, "w", encoding="utf-8") as stderr:
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=stderr, text=True)
        assert waited_for(lambda: "view: http" in log.read_text(), 60)
        url = log.read_text().split()[1]
        assert waited_for(lambda: answers(url))
        assert process.poll() is None, "the run continues"
        os.kill(viewer_at(url), signal.SIGKILL)
        printed, _ = process.communicate(timeout=120)
    assert process.returncode == 0
    assert json.loads(printed)["method"] == "paper"
    assert len(RunFolder.open(out).recordings()) > 5
    assert (
        "view: the Rerun viewer failed with exit code 247; 'equipoise view RUN' shows the run again" in log.read_text()
    )


def test_a_killed_view_leaves_the_run_alone(a1, ideal_motions, tmp_path):
    folder = RunFolder.create(tmp_path / "run", a1, BayesianMethod(), {})
    with folder, live_viewer(folder.path, str(tmp_path / "a.rrd")) as process:
        folder.keep(ideal_motions.move)
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        folder.keep(ideal_motions.lift)
    assert len(RunFolder.open(folder.path).recordings()) == 2


def test_the_page_ends_with_the_run_however_that_ends(run, tmp_path):
    code = (
        "import sys, time\nfrom pathlib import Path\nfrom equipoise.view.viewer import live_viewer\n"
        "with live_viewer(Path(sys.argv[1]), 'browser'):\n    time.sleep(60)"
    )
    with open(tmp_path / "stderr", "w+", encoding="utf-8") as stderr:
        process = subprocess.Popen([sys.executable, "-c", code, str(run)], stderr=stderr)
        assert waited_for(lambda: "view: http" in (tmp_path / "stderr").read_text(), 60)
        url = (tmp_path / "stderr").read_text().split()[1]
        assert waited_for(lambda: answers(url))
        process.kill()
        process.communicate()
        assert waited_for(lambda: not answers(url))


def test_a_calibration_with_a_view_has_the_same_result(tmp_path, capsys):
    assert main([*QUICK, "--out", str(tmp_path / "without")]) == 0
    without = json.loads(capsys.readouterr().out)
    out = tmp_path / "with"
    assert main([*QUICK, "--out", str(out), "--view"]) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["composite"] == without["composite"]
    assert printed.err == f"saved: {out}/view.rrd\nopen it: rerun {out}/view.rrd\n"
    entities = read_rrd(out / "view.rrd")
    assert len(entities["/trials"].times) == len(RunFolder.open(out).recordings())


def test_how_to_open_a_view():
    page = how_to_open("http://127.0.0.1:9090/?url=rerun%2Bhttp://127.0.0.1:9876/proxy")
    assert page.startswith(
        "view: http://127.0.0.1:9090/?url=rerun%2Bhttp://127.0.0.1:9876/proxy\n"
        "      from another computer: ssh -L 9090:127.0.0.1:9090 -L 9876:127.0.0.1:9876 "
    )
    assert page.endswith(", then open the same address there")
    assert how_to_open(WINDOW) == "view: in a Rerun window"
    assert how_to_open("a.rrd") == "view: recorded in a.rrd"


def test_a_port_in_use_is_replaced_by_a_free_one():
    with closing(socket.create_server(("127.0.0.1", 0))) as taken:
        port = taken.getsockname()[1]
        assert free_port(port) not in (0, port)
    assert free_port(port) == port


def test_a_window_needs_a_display(monkeypatch):
    monkeypatch.setattr(sys, "platform", "linux")
    assert not has_display()
    monkeypatch.setenv("DISPLAY", ":0")
    assert has_display()
    assert BROWSER != WINDOW


@pytest.mark.parametrize("verb", [["calibrate", "--out", "run", "--view"], ["view", "."]])
def test_a_missing_package_is_named_before_anything_moves(tmp_path, verb):
    code = f"import sys; sys.modules['rerun'] = None\nfrom equipoise.cli import main\nsys.exit(main({verb!r}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=tmp_path)
    message = "error: the view needs rerun-sdk: pip install 'equipoise[view]'\n"
    assert (done.returncode, done.stderr) == (7, message)
    assert list(Path(tmp_path).iterdir()) == []


@pytest.mark.parametrize(
    ("flags", "code", "message"),
    [
        (["calibrate", "--browser"], 2, "--browser needs --view; give both"),
        (["view", "nowhere"], 5,
         "'nowhere' does not exist; name the run folder of a calibration, or pass --robot ROBOT for a log of another program"),
        (["view", ".", "--from", "3s"], 2,
         "tables, topics, --joint-map, --columns, --rate, --from, --until and robot flags are for logs of other programs; "
         "pass --robot too"),
        (["view", ".", "--out", "gone/a.rrd"], 6, "'gone/a.rrd' cannot be written: there is no folder 'gone'"),
        (["view", ".", "--out", "a.mp4"], 6, "'a.mp4' is not the name of a Rerun file; append .rrd"),
    ],
)  # fmt: skip
def test_flags_that_cannot_be_used_are_refused(tmp_path, monkeypatch, capsys, flags, code, message):
    monkeypatch.chdir(tmp_path)
    assert main(flags) == code
    assert capsys.readouterr().err == f"error: {message}\n"


@pytest.mark.skipif(sys.platform != "linux", reason="a display that does not exist needs X11")
def test_a_window_that_cannot_be_opened_is_reported(run, monkeypatch, capsys):
    monkeypatch.setenv("DISPLAY", ":99")
    assert main(["view", str(run), "--quiet"]) == 6
    error = r"error: the Rerun viewer failed with exit code \d+; 'equipoise view RUN' shows the run again\n"
    assert re.fullmatch(error, capsys.readouterr().err)
