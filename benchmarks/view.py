"""Effect of the view on the control loop: `make bench-view`.

An emulated Go2 sends its messages over DDS in its own process. The guarded loop plays a slow motion at 500 Hz in real time and
writes its log, as in a calibration: without a view, with a view recorded in a file, and with a view in a browser. Each case
takes a minute, in several rounds. Results are stored in benchmarks/results/view.json; --tables only writes
benchmarks/results/view.md.
"""

from __future__ import annotations

import json
import os
import platform
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import numpy as np
import tyro
from provenance import commit, write_page

import equipoise
from equipoise import BayesianMethod, RunFolder, Trajectory, load_robot, nominal_stance
from equipoise.guard.remote_robot import RemoteRobot
from equipoise.view.viewer import BROWSER, free_port, live_viewer

RESULTS = Path(__file__).parent / "results"
ROBOT, DOMAIN = "unitree_a1", 73
LIMIT = 1.0  # [ms]
CASES = ("no view", "view in a file", "view in a browser")
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
MODEL = load_robot(ROBOT)
STANCE = nominal_stance(MODEL).joint_position


@dataclass(frozen=True)
class Options:
    """Settings of the benchmark.

    Attributes:
        seconds: duration of each case in each round, at most 60.
        rounds: number of rounds of all cases.
        tables: only write the page.
        realtime: real-time scheduling of emulator and loop, for busy machines (as root).
    """

    seconds: float = 40.0
    rounds: int = 3
    tables: bool = False
    realtime: bool = False


OPTIONS = Options()


@contextmanager
def robot() -> Generator[None]:
    """Run an emulator in its own process."""
    command = [sys.executable, "-m", "equipoise.lab.emulators.unitree_dds", "--robot", ROBOT, "--domain", str(DOMAIN)]
    flags = ("--start", "standing", "--no-sport-mode", "--sim-preset", "ideal")
    with tempfile.TemporaryFile("w+") as log:
        process = subprocess.Popen([*command, *flags], stdin=subprocess.DEVNULL, stdout=log)
        try:
            time.sleep(5.0)
            yield
        finally:
            process.terminate()
            process.wait(timeout=10)


@contextmanager
def looked_at(case: str, folder: Path) -> Generator[None]:
    """Show a run in the view of a case."""
    if case == CASES[0]:
        yield
        return
    if case == CASES[1]:
        with live_viewer(folder, str(folder / "view.rrd")):
            yield
        return
    if CHROMIUM is None:
        raise SystemExit("a view in a browser needs chromium")
    page, data = free_port(9090), free_port(9876)  # the viewer's defaults
    url = f"http://127.0.0.1:{page}/?url=rerun%2Bhttp://127.0.0.1:{data}/proxy&renderer=webgl"
    with live_viewer(folder, BROWSER), tempfile.TemporaryDirectory() as profile:
        time.sleep(5.0)
        software = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
        flags = ("--headless", "--no-sandbox", *software)
        # In practice the browser is on another computer, so it has the lowest priority here.
        browser = subprocess.Popen(
            ["nice", "-n", "19", CHROMIUM, *flags, f"--user-data-dir={profile}", "--remote-debugging-port=0", url],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        time.sleep(10.0)
        try:
            yield
        finally:
            browser.terminate()
            browser.wait(timeout=20)


def measured(case: str, seconds: float) -> dict[str, Any]:
    """Return the delays of commands [ms], and the number of reset deadlines."""
    with tempfile.TemporaryDirectory() as place, robot():
        folder = RunFolder.create(Path(place) / "run", MODEL, BayesianMethod(), {})
        with folder, looked_at(case, folder.path):
            remote = RemoteRobot(
                "unitree-go2", MODEL, {"interface": "lo", "domain": DOMAIN}, folder.log, realtime=OPTIONS.realtime
            )
            trajectory = excitation()
            with remote:
                for _ in range(round(seconds / (len(trajectory.position) * 2e-3))):
                    remote.play(trajectory)
            report = remote.report()
            return {
                "load": os.getloadavg()[0],
                "percentiles": [1e3 * (report.late_999 or 0.0), 1e3 * (report.latest or 0.0)],
                "on_time": 1 - (report.overruns or 0) / report.commands,
                "lost": report.stalls,
            }


def excitation() -> Trajectory:
    """Return a slow motion of five seconds that extends and retracts all legs."""
    at = np.arange(2500) * 2e-3
    position = np.repeat(STANCE[None], len(at), axis=0)
    for place, leg in enumerate(MODEL.legs.values()):
        wave = 0.05 * np.sin(2 * np.pi * at) * (-1) ** place
        position[:, leg.joints[-2]] += wave
        position[:, leg.joints[-1]] -= 2 * wave
    return Trajectory(position)


def table(results: dict[str, list[dict[str, Any]]]) -> list[str]:
    """Return the table, with medians of percentiles and shares over the rounds of a case."""
    rounds = [results[case] for case in CASES]
    rows = ["| delay | " + " | ".join(CASES) + " |", "|---|" + "---|" * len(CASES)]
    for place, name in enumerate(("99.9 %", "latest")):
        cells = [statistics.median(r["percentiles"][place] for r in case) for case in rounds]
        rows.append(f"| {name} | " + " | ".join(f"{cell:.3f} ms" for cell in cells) + " |")
    shares = [[r["on_time"] for r in case] for case in rounds]
    rows.append(f"| within {LIMIT:g} ms | " + " | ".join(f"**{statistics.median(s):.3%}**" for s in shares) + " |")
    rows.append("| range over rounds | " + " | ".join(f"{min(s):.2%} to {max(s):.2%}" for s in shares) + " |")
    rows.append("| deadlines missed | " + " | ".join(str(sum(r["lost"] for r in case)) for case in rounds) + " |")
    rows.append("| load of the machine | " + " | ".join(f"{max(r['load'] for r in c):.1f}" for c in rounds) + " |")
    return rows


def _scheduled(realtime: bool) -> str:
    return "; both have real-time priority on a busy machine" if realtime else ""


def report(kept: dict[str, Any]) -> str:
    """Write the page."""
    lines = [
        "# Effect of the view on the control loop",
        "",
        f"`make bench-view`; equipoise {equipoise.__version__}, Python {platform.python_version()}, {os.cpu_count()} cores. "
        "An emulator sends a Go2's messages over DDS on loopback, in its own process; the guarded loop "
        "oscillates it "
        f"at 500 Hz and writes its log{_scheduled(kept['realtime'])}. {kept['rounds']} rounds of {kept['seconds']:.0f} s for "
        "each case, in turn. Delay of commands after their deadlines:",
        "",
        *table(kept["cases"]),
        "",
        "The view is a separate process that reads the log at a lower priority (nice 10), without work for the loop. "
        "The remaining effect is competition for cores: emulator, loop, view and a browser without a graphics card share one "
        "machine here. In practice robot and browser are on other machines.",
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    global OPTIONS  # noqa: PLW0603
    OPTIONS = options = tyro.cli(Options)
    warnings.simplefilter("ignore")
    path = RESULTS / "view.json"
    if not options.tables:
        cases: dict[str, list[dict[str, Any]]] = {case: [] for case in CASES}
        for _ in range(options.rounds):
            for case in CASES:
                cases[case].append(measured(case, min(options.seconds, 60.0)))
                print(case, cases[case][-1], flush=True)
        kept = {"seconds": options.seconds, "rounds": options.rounds, "realtime": options.realtime, "cases": cases}
        kept["commit"] = commit()
        path.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    text = report(json.loads(path.read_text(encoding="utf-8")))
    write_page("view.md", text, [kept])
    print(text)


if __name__ == "__main__":
    main()
