"""The page in a real browser, the process that serves it beside a run, and the file for Rerun."""

import io
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from contextlib import closing, contextmanager

import numpy as np
import pytest
from matplotlib.image import imread

from equipoise import Precise, RunFolder
from equipoise.cli import main
from equipoise.errors import SettingsError
from equipoise.view.open import Viewing, open_run
from equipoise.view.process import ViewerProcess, how_to_look

pytest.importorskip("viser", reason="no viser: the live view was NOT tried")
EQUIPOISE = [sys.executable, "-m", "equipoise"]
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
SOFTWARE_GL = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


@pytest.fixture(scope="module")
def run(a1, ideal_motions, tmp_path_factory):
    """A run of a move and a lift."""
    folder = RunFolder.create(tmp_path_factory.mktemp("runs") / "short", a1, Precise(), {})
    with folder:
        folder.keep(ideal_motions.move)
        folder.keep(ideal_motions.lift)
    return folder.path


@contextmanager
def served(*arguments):
    """`equipoise view`, and the address that it tells."""
    command = [*EQUIPOISE, "view", *map(str, arguments), "--view-port", "0", "--json"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        yield process, json.loads(process.stdout.readline())["url"]
    finally:
        process.kill()
        process.communicate()


@pytest.fixture(scope="module")
def browser():
    sync_api = pytest.importorskip("playwright.sync_api", reason="no playwright: the page was NOT tried in a browser")
    if CHROMIUM is None:
        pytest.skip("no chromium: the page was NOT tried in a browser")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE_GL)
        yield browser
        browser.close()


def pixels(page):
    """(h, w, 3) of the robot's part of the page."""
    return imread(io.BytesIO(page.screenshot(clip={"x": 50, "y": 100, "width": 300, "height": 300})))[..., :3]


@pytest.fixture
def minute(a1, precise_run, tmp_path):
    """A run of a minute: a browser that draws without a graphics card and beside other work sees its beginning."""
    folder = RunFolder.create(tmp_path / "minute", a1, precise_run.settings, {})
    with folder:
        for recording in precise_run.recordings:
            folder.keep(recording)
    return folder.path


def test_the_page_shows_the_robot_and_its_timeline_works(minute, precise_run, browser):
    of = f"of {len(precise_run.recordings)}"
    with served(minute) as (_, url):
        page = browser.new_page(viewport={"width": 720, "height": 480})  # drawn without a graphics card
        trouble = []
        page.on("console", lambda said: trouble.append(said.text) if said.type == "error" else None)
        page.on("pageerror", lambda error: trouble.append(str(error)))
        page.on("request", lambda request: trouble.append(request.url) if not request.url.startswith(url) else None)
        page.goto(url)
        page.get_by_text(f"{of}: ").wait_for(timeout=60_000)
        assert page.locator("canvas").count() >= 1
        page.get_by_text("Pause", exact=True).click()
        page.get_by_text("paused").wait_for(timeout=20_000)
        shown = pixels(page)
        assert shown.std(axis=(0, 1)).max() > 0.03, "something is drawn"
        page.get_by_label("jump to").click()
        page.get_by_text("14: lift FL_RR roll").last.click()
        page.get_by_text(f"Trial 14 {of}: lift FL_RR roll").wait_for(timeout=20_000)
        assert waited_for(lambda: np.abs(pixels(page) - shown).max() > 0.1), "the robot has moved"
        page.get_by_text("Play", exact=True).click()
        page.get_by_text("tilt about the line").wait_for(timeout=30_000)
        page.get_by_text("CoM in base").wait_for(timeout=60_000)
        assert page.locator("svg title", has_text="Centre of mass from above").count() == 1
        page.close()
        assert [text for text in trouble if not text.startswith(("data:", "blob:", url.replace("http", "ws")))] == []


def test_ctrl_c_ends_the_page(run):
    with served(run) as (process, url):
        assert urllib.request.urlopen(url).status == 200
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=20) == 0
        assert process.stderr.read() == ""


def refused(url):
    try:
        urllib.request.urlopen(url, timeout=1)
    except (urllib.error.URLError, OSError):
        return True
    return False


def waited_for(what, patience=10.0):
    end = time.monotonic() + patience
    while not what() and time.monotonic() < end:
        time.sleep(0.05)
    return what()


def test_a_killed_viewer_is_nothing_to_the_run(a1, ideal_motions, tmp_path):
    folder = RunFolder.create(tmp_path / "run", a1, Precise(), {})
    with folder, ViewerProcess(folder.path, port=0) as viewer:
        folder.keep(ideal_motions.move)
        os.kill(viewer.pid, signal.SIGKILL)
        folder.keep(ideal_motions.lift)
    assert len(RunFolder.open(folder.path).recordings()) == 2
    assert refused(viewer.url)


def test_the_viewer_ends_with_the_run_however_that_ends(run):
    code = (
        "import sys, time\nfrom pathlib import Path\nfrom equipoise.view.process import ViewerProcess\n"
        "viewer = ViewerProcess(Path(sys.argv[1]), port=0)\nprint(viewer.url, flush=True)\ntime.sleep(60)"
    )
    process = subprocess.Popen([sys.executable, "-c", code, str(run)], stdout=subprocess.PIPE, text=True)
    url = process.stdout.readline().strip()
    assert not refused(url)
    process.kill()
    process.communicate()
    assert waited_for(lambda: refused(url))


def test_a_calibration_with_a_view_is_the_one_without(tmp_path, capsys):
    quick = ["calibrate", "--method", "static", "--noise", "realistic", "--quiet", "--json"]
    assert main([*quick, "--out", str(tmp_path / "without")]) == 0
    without = json.loads(capsys.readouterr().out)
    assert main([*quick, "--out", str(tmp_path / "with"), "--view", "--view-port", "0"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["composite"] == without["composite"]
    url = said.err.split()[1]
    assert said.err.startswith("view: http://127.0.0.1:")
    assert f"ssh -L {url.rsplit(':', 1)[1]}:127.0.0.1:{url.rsplit(':', 1)[1]} " in said.err
    assert refused(url), "nobody is at a terminal: the page ends with the run"


def test_how_to_look_from_elsewhere():
    said = how_to_look("http://127.0.0.1:8123")
    assert said.startswith("view: http://127.0.0.1:8123\n      from another computer: ssh -L 8123:127.0.0.1:8123 ")
    assert said.endswith(", then open http://127.0.0.1:8123 there")


def test_a_port_in_use_is_said_before_anything_moves(run, tmp_path, capsys):
    with closing(socket.create_server(("127.0.0.1", 0))) as taken:
        port = taken.getsockname()[1]
        message = (
            f"the view cannot be served at 127.0.0.1:{port}: Address already in use; choose another port with --view-port, "
            "or 0 for any that is free"
        )
        with pytest.raises(SettingsError) as error:
            ViewerProcess(run, port=port)
        assert str(error.value) == message
        assert main(["view", str(run), "--view-port", str(port)]) == 2
        assert capsys.readouterr().err == f"error: {message}\n"
        out = tmp_path / "run"
        assert main(["calibrate", "--view", "--view-port", str(port), "--out", str(out)]) == 2
        assert not out.exists()


@pytest.mark.parametrize(
    ("package", "flags", "message"),
    [
        ("viser", ["--view"], "the live view needs viser: pip install 'equipoise[view]'"),
        ("rerun", ["--rerun", "a.rrd"], "a Rerun file needs rerun-sdk: pip install 'equipoise[rerun]'"),
    ],
)
def test_a_missing_package_is_said_before_anything_moves(tmp_path, package, flags, message):
    code = (
        f"import sys; sys.modules[{package!r}] = None\nfrom equipoise.cli import main\n"
        f"sys.exit(main(['calibrate', '--out', 'run', *{flags!r}]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (7, f"error: {message}\n")
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("flags", "code", "message"),
    [
        (["calibrate", "--view-port", "9000"], 2, "--view-port is the port of --view's page; give --view too"),
        (["calibrate", "--view", "--view-port", "70000"], 2,
         "--view-port is 70000; a port is from 1 to 65535, or 0 for any that is free"),
        (["calibrate", "--repeat", "2", "--rerun", "a.rrd"], 2,
         "--rerun writes one run; with --repeat use 'equipoise view RUN --rerun FILE.rrd' afterwards"),
        (["view", "nowhere", "--view-port", "0"], 5,
         "'nowhere' does not exist; name the run folder of a calibration"),
        (["view", "nowhere", "--view-port", "0", "--from", "3s"], 2,
         "topics, --joint-map, --columns, --from, --until and descriptions are for logs that are not ours: give --robot too"),
        (["view", "nowhere", "--rerun", "gone/a.rrd"], 6, "'gone/a.rrd' cannot be written: there is no folder 'gone'"),
    ],
)  # fmt: skip
def test_flags_that_cannot_be_used_are_refused(tmp_path, monkeypatch, capsys, flags, code, message):
    monkeypatch.chdir(tmp_path)
    assert main(flags) == code
    assert capsys.readouterr().err == f"error: {message}\n"


def test_the_rerun_file_holds_the_robot_the_com_and_the_curves(run, tmp_path, capsys):
    pytest.importorskip("rerun", reason="no rerun: the file was NOT tried")
    chunk = pytest.importorskip("rerun.chunk", reason="this rerun cannot read its files back")
    path = tmp_path / "run.rrd"
    assert main(["view", str(run), "--rerun", str(path), "--quiet"]) == 0
    assert capsys.readouterr().out == f"saved: {path}\nopen it: rerun {path}\n"
    chunks = {}
    for piece in chunk.RrdReader(str(path)).stream():
        chunks.setdefault(str(piece.entity_path), []).append(piece)
    expected = {"world/robot", "world/robot/FL_calf_joint", "world/com", "world/com/ellipsoid", "world/com/planes"}
    expected |= {"world/support_line", "world/contacts", "tilt_deg", "torque/RR_thigh_joint", "com_95_mm/z", "trials"}
    assert {f"/{entity}" for entity in expected} <= set(chunks)
    with Viewing(open_run(run)) as viewing:
        viewing.refresh()
        start, end = viewing.film.span
    (tilt,) = (piece.to_record_batch() for piece in chunks["/tilt_deg"])
    times = np.array([value.total_seconds() for value in tilt.column("time").to_pylist()])
    assert (times[0], times[-1]) == pytest.approx((start, end), abs=0.05)
    assert np.diff(times).max() < 0.05
    values = np.array([row[0] for row in tilt.column("Scalars:scalars").to_pylist()])
    assert np.nanmax(np.abs(values)) > 0.5, "the lift tilted it"
    assert main(["view", str(run), "--rerun", str(path)]) == 6
    assert capsys.readouterr().err == f"error: {str(path)!r} exists; name a new file with --rerun\n"
