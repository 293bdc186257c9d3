"""Time to write and to draw a report: `make bench-report`. Writes benchmarks/results/report.md.

Reports of a simulated A1 with typical sensors and a payload: methods `bayesian`, `paper`, and their comparison. Chromium
draws without a graphics card (WebGL in software), so a desktop is faster.
"""

from __future__ import annotations

import os
import shutil
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

from provenance import write_page

from equipoise import Calibration, calibrate, load_robot, simulate
from equipoise.method.table import method_named
from equipoise.report.page import save_comparison, save_report

RESULTS = Path(__file__).parent / "results"
TIMES = 5
NAMES = ("chromium", "chromium-browser", "google-chrome")
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
# Milliseconds since the start of the navigation: first frame with text, and end of drawing.
FIRST = """() => new Promise((done) => {
  const painted = () => performance.getEntriesByName('first-contentful-paint')[0]?.startTime;
  const wait = () => (painted() ? done(painted()) : requestAnimationFrame(wait)); wait(); })"""
ALL = "() => { const start = performance.now(); return Promise.all(plots.map(draw)).then(() => performance.now() - start); }"


def results() -> dict[str, Calibration]:
    """Return a calibration with each method."""
    robot = load_robot("unitree_a1")
    found = {}
    for method in ("bayesian", "paper"):
        with simulate(robot, "realistic", "1,0.05,0.02,0.08", 3) as simulation:
            result = calibrate(simulation.platform, robot, method_named(method)())
        found[method] = result.with_truth(simulation.truth)
    return found


def written(save: Callable[[Path], Path], path: Path) -> tuple[float, float, float]:
    """Return the median time to write a page, its processor time [s], and its size [MB]."""
    times, worked = [], []
    for _ in range(TIMES):
        start, work = time.perf_counter(), time.process_time()
        save(path)
        times.append(time.perf_counter() - start)
        worked.append(time.process_time() - work)
    return statistics.median(times), statistics.median(worked), path.stat().st_size / 1e6


def shown(pages: list[Path]) -> list[tuple[float, float] | None]:
    """Return the median times until the first screen and until all figures are drawn [s]; None without a browser."""
    executable = next(filter(None, map(shutil.which, NAMES)), None)
    if executable is None:
        print(f"none of {', '.join(NAMES)} is installed; drawing is not measured")
        return [None] * len(pages)
    from playwright.sync_api import sync_playwright  # noqa: PLC0415 - only installed with a browser

    found = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=FLAGS)
        for path in pages:
            firsts, wholes = [], []
            for _ in range(TIMES):
                page = browser.new_page(viewport={"width": 1280, "height": 800})
                page.goto(path.as_uri())
                firsts.append(page.evaluate(FIRST) / 1000)
                wholes.append(page.evaluate(ALL) / 1000)
                page.close()
            found.append((statistics.median(firsts), statistics.median(wholes)))
        browser.close()
    return found


def main() -> None:
    """All pages."""
    busy = os.getloadavg()[0]
    found = results()
    with tempfile.TemporaryDirectory() as folder:
        saves = {name: lambda path, result=result: save_report(result, path) for name, result in found.items()}
        saves["both compared"] = lambda path: save_comparison(found, path)
        paths = [Path(folder) / f"{name}.html" for name in saves]
        writing = [written(save, path) for save, path in zip(saves.values(), paths, strict=True)]
        showing = shown(paths)
    lines = [
        "# Time to write and draw a report",
        "",
        f"`make bench-report`; medians of {TIMES}, on {os.cpu_count()} cores with a load of {busy:.1f} before (idle: 0).",
        "Chromium without a graphics card. First screen: numbers and top view are painted;",
        "figures further down are drawn when scrolled near.",
        "",
        "| page | written in [s] | processor time [s] | size [MB] | first screen [s] | all figures drawn [s] |",
        "|---|---|---|---|---|---|",
    ]
    for name, (seconds, work, size), seen in zip(saves, writing, showing, strict=True):
        first, whole = ("-", "-") if seen is None else (f"{seen[0]:.2f}", f"{seen[1]:.2f}")
        lines.append(f"| {name} | {seconds:.2f} | {work:.2f} | {size:.1f} | {first} | {whole} |")
    write_page("report.md", "\n".join(lines) + "\n")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
