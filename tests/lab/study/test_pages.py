"""Pages of studies, in a browser and as Markdown."""

import numpy as np
import pytest
from browser import open_browser

from equipoise.lab.pages.markdown import markdown
from equipoise.lab.pages.reproduction_page import reproduction_page
from equipoise.lab.pages.study_page import study_page
from equipoise.lab.study.reproduction import Reproduction
from equipoise.lab.study.rows import table_of
from equipoise.lab.study.study import SOURCES, Study
from equipoise.lab.study.study_statistics import Slope, summarize
from equipoise.report.page import save_page
from equipoise.robot.inertial import COMPONENTS

COUNT = 40


@pytest.fixture(scope="module")
def rows():
    """Rows of calibrations with intervals, with a planar error proportional to the size of the joint offsets."""
    rng = np.random.default_rng(2)
    truths = {f"true_{name}": 1.0 for name in COMPONENTS}
    truths |= {f"true_stance_effective_{axis}": 0.1 for axis in ("roll", "pitch", "yaw")}
    sizes = dict.fromkeys([f"size_{name}" for name in SOURCES], 0.0)
    found = []
    for trial in range(COUNT):
        size, (x, y) = rng.uniform(0, 1e-2), rng.normal(size=2)
        found.append({
            "trial": trial, "method": "bayesian", "status": "ok", "message": "", **truths, **sizes, "payload_mass": 0.0,
            "size_joint_offset": size, "joint_zero_rms": size, "foot_error_rms": 0.3 * size,
            "estimated_com_x": 1.0 + 0.3 * size * x, "estimated_com_y": 1.0 + 0.3 * size * y,
            "std_com_x": 1.5e-3, "std_com_y": 1.5e-3, "robot_time": 100.0, "cpu_time": 1.0,
        })  # fmt: skip
    return table_of(found)


@pytest.fixture(scope="module")
def pages(rows):
    slopes = [Slope("bayesian", "size_joint_offset", 0.3, 0.02)]
    errors = np.abs(np.random.default_rng(3).normal(2e-3, 1e-3, COUNT))
    halvings = np.outer(np.ones(COUNT), [0.03, 0.015, 0.008, 0.004])
    table = (
        ("truth", "", (0.1, 0.3, 0.4, 1e-3, 2e-3)),
        ("paper", "ideal", (0.1, None, 0.4, 2e-3, 2e-3)),
    )
    done = Reproduction(table, tuple(summarize(rows)), halvings, errors, rows)
    return {
        "study": study_page(Study(vary_effects=True), rows, summarize(rows), slopes),
        "reproduction": reproduction_page(done),
    }


def test_every_figure_of_a_study_is_drawn(pages, tmp_path):
    counts = {}
    for browser in open_browser():
        for name, contents in pages.items():
            page = browser.new_page(viewport={"width": 400, "height": 800})
            page.goto(save_page(contents, tmp_path / f"{name}.html").as_uri())
            page.evaluate("Promise.all(plots.map(draw)).then(() => null)")
            page.wait_for_function("plots.every((plot) => plot.querySelector('.cartesianlayer .trace path'))")
            counts[name] = page.evaluate("plots.length")
            assert page.evaluate("document.documentElement.scrollWidth") <= 400
    assert counts == {"study": 3, "reproduction": 3}


def test_the_reproduction_as_markdown_has_its_tables_in_order(pages):
    text = markdown(pages["reproduction"], "report.html")
    heads = [line for line, below in zip(text.splitlines(), text.splitlines()[1:], strict=False) if below[:4] == "|---"]
    assert [head.split(" | ")[0].strip("| ") for head in heads] == ["", "iteration", "method"]
    assert "| paper | ideal | 0.1000 (+0%) | - | 0.4000 (+0%) | 2.00 (+1.00) | 2.00 (+0.00) |" in text
    assert f"| bayesian | {COUNT} | " in text
    assert (
        "[Figure: Fig. 3: CoM error by iteration](report.html#fig-3-error-of-the-com-by-iteration-of-the-search)"
        in text
    )
