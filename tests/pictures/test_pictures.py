from __future__ import annotations

import dataclasses
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Ellipse
from matplotlib.text import Annotation, Text

from equipoise import Calibration, nominal_stance
from equipoise.errors import OutputError
from equipoise.pictures.files import save_plan_view
from equipoise.pictures.plan_view import draw_plan_view
from equipoise.result.body import Body
from equipoise.robot.model import LEG_NAMES, RobotModel

pytestmark = pytest.mark.usefixtures("coarse_engine")

DRAW_IN_A_FRESH_PYTHON = """
import sys
from equipoise import Calibration
from equipoise.pictures.files import save_plan_view

save_plan_view(Calibration.load(sys.argv[1]), sys.argv[2])
assert "matplotlib.pyplot" not in sys.modules
"""


@pytest.fixture(scope="module")
def calibration(paper_result: Calibration) -> Calibration:
    return paper_result


def drawn(calibration: Calibration) -> Figure:
    figure = draw_plan_view(calibration)
    assert figure is not None
    return figure


def texts(figure: Figure) -> list[str]:
    """Every text in a figure, its lines joined."""
    return [" ".join(text.get_text().split()) for text in figure.findobj(Text) if text.get_text()]


def marked(axes: Axes, marker: str) -> np.ndarray:
    """x and y in the base frame [mm] of the one point with a marker; axes show y across and x up."""
    (line,) = [line for line in axes.get_lines() if line.get_marker() == marker]
    return np.asarray(line.get_data(), dtype=float)[::-1, 0]


def assert_nothing_is_clipped(figure: Figure) -> None:
    figure.draw_without_rendering()
    width, height = figure.get_size_inches()
    box = figure.get_tightbbox()
    assert box.x0 >= 0
    assert box.y0 >= 0
    assert box.x1 <= width
    assert box.y1 <= height


def test_the_picture_is_a_png_file_of_a_readable_size(calibration: Calibration, tmp_path: Path) -> None:
    (path,) = save_plan_view(calibration, tmp_path / "new" / "folder")

    content = path.read_bytes()
    width, height = struct.unpack(">II", content[16:24])
    assert path.name == "plan_view.png"
    assert content.startswith(b"\x89PNG")
    assert 1200 <= width <= 2400
    assert 800 <= height <= 2400
    assert 30_000 < len(content) < 1_000_000


@pytest.mark.parametrize("folder", ["file", "file/inside"])
def test_a_folder_that_cannot_be_written_is_an_output_error(
    calibration: Calibration, tmp_path: Path, folder: str
) -> None:
    (tmp_path / "file").write_text("in the way")

    with pytest.raises(OutputError, match="cannot write the pictures"):
        save_plan_view(calibration, tmp_path / folder)


def test_a_result_that_does_not_know_its_com_has_no_picture(calibration: Calibration, tmp_path: Path) -> None:
    unknown = dataclasses.replace(calibration, composite=Body.of(np.full(10, np.nan)))

    assert save_plan_view(unknown, tmp_path) == []


def test_the_close_up_marks_the_com_as_found_as_it_is_and_as_modelled(calibration: Calibration) -> None:
    assert calibration.truth is not None
    close_up = drawn(calibration).axes[1]

    np.testing.assert_allclose(marked(close_up, "+"), calibration.composite.com_in_base.values[:2] * 1000)
    np.testing.assert_allclose(marked(close_up, "o"), calibration.truth.composite.com[:2] * 1000)
    np.testing.assert_allclose(marked(close_up, "D"), calibration.nominal.composite.com[:2] * 1000)


def test_it_names_the_robot_the_method_the_result_and_the_error(calibration: Calibration) -> None:
    assert calibration.truth is not None
    x, y = calibration.composite.com_in_base.values[:2] * 1000
    error = np.hypot(*(np.array([x, y]) - calibration.truth.composite.com[:2] * 1000))
    lifts = sum(trial.kind == "lift" for trial in calibration.trials)

    shown = "\n".join(texts(drawn(calibration)))

    assert 4 <= lifts < len(calibration.trials)  # two bounds on either diagonal at least, and sways are no lifts
    assert f"unitree_a1: method paper, feet measured, {lifts} lifts" in shown
    assert f"CoM x {x:.2f} mm, CoM y {y:.2f} mm" in shown
    assert f"x = {x:.1f} mm, y = {y:.1f} mm" in shown
    assert f"error {error:.1f} mm" in shown


def test_the_robot_is_seen_from_above_with_named_feet(calibration: Calibration, a1: RobotModel) -> None:
    overview = drawn(calibration).axes[0]
    feet = nominal_stance(a1).feet_in_base[:, :2] * 1000

    right, left = sorted(overview.get_xlim())
    assert overview.get_xlim() == (left, right), "left is to the left"
    assert overview.get_ylim()[0] < overview.get_ylim()[1], "forward is up"
    discs = [patch for patch in overview.patches if isinstance(patch, Circle)]
    np.testing.assert_allclose([disc.center for disc in discs], feet[:, ::-1])
    assert all(disc.get_radius() == pytest.approx(20.0) for disc in discs)
    names = [text for text in overview.texts if text.get_text() in LEG_NAMES]
    assert [name.get_text() for name in names] == list(LEG_NAMES)


def test_every_lift_has_a_line_and_verdicts_look_different(calibration: Calibration) -> None:
    close_up = drawn(calibration).axes[1]
    lifts = [trial for trial in calibration.trials if trial.kind == "lift"]

    lines = [line for line in close_up.get_lines() if line.get_alpha() is not None]

    assert len(lines) == len(lifts)
    for line, lift in zip(lines, lifts, strict=True):
        assert line.is_dashed() == (lift.verdict != "forward")
    assert lines[0].get_alpha() < lines[-1].get_alpha()


def test_arrows_point_to_the_side_that_the_com_is_on(calibration: Calibration) -> None:
    close_up = drawn(calibration).axes[1]
    lifts = [trial for trial in calibration.trials if trial.kind == "lift"]
    arrows = [text for text in close_up.texts if isinstance(text, Annotation)]

    assert len(arrows) == len(lifts)
    for arrow, lift in zip(arrows, lifts, strict=True):
        assert (arrow.xy[1] > arrow.xyann[1]) == (lift.verdict == "forward")


def test_the_found_support_lines_cross_at_the_com(calibration: Calibration) -> None:
    close_up = drawn(calibration).axes[1]
    com = marked(close_up, "+")
    thickest = sorted(close_up.get_lines(), key=lambda line: line.get_linewidth())[-2:]
    for line in thickest:
        (y_a, y_b), (x_a, x_b) = np.asarray(line.get_data(), dtype=float)
        area = (x_b - x_a) * (com[1] - y_a) - (y_b - y_a) * (com[0] - x_a)
        assert abs(area) / np.hypot(x_b - x_a, y_b - y_a) < 1e-6


def test_the_ellipse_is_drawn_where_the_com_is_likely(calibration: Calibration) -> None:
    covariance = np.zeros((10, 10))
    covariance[1:3, 1:3] = 1e-6 * np.array([[9.0, 5.0], [5.0, 4.0]])
    values = np.array([quantity.value or 0.0 for quantity in calibration.composite])
    composite = Body.of(values, covariance).with_model(calibration.nominal.composite)
    close_up = drawn(dataclasses.replace(calibration, composite=composite)).axes[1]

    (ellipse,) = [patch for patch in close_up.patches if isinstance(patch, Ellipse)]
    points = np.random.default_rng(1).multivariate_normal(values[1:3], covariance[1:3, 1:3], 20_000) * 1000
    inside = ellipse.get_path().transformed(ellipse.get_patch_transform()).contains_points(points[:, ::-1])

    assert np.mean(inside) == pytest.approx(0.95, abs=0.01)


def test_a_result_without_truth_shows_no_error(calibration: Calibration) -> None:
    figure = drawn(calibration.with_truth(None))

    assert not any("error" in text or "truth" in text for text in texts(figure))


def test_the_close_up_is_drawn_without_the_robot_model(calibration: Calibration) -> None:
    figure = drawn(dataclasses.replace(calibration, robot_model=None))

    assert len(figure.axes) == 1
    assert "Around the CoM" in "\n".join(texts(figure))


def test_a_result_from_a_json_file_has_the_lines_found_and_no_lifts(calibration: Calibration, tmp_path: Path) -> None:
    calibration.save(tmp_path / "result.json")

    (close_up,) = drawn(Calibration.load(tmp_path / "result.json")).axes

    assert [line.get_alpha() for line in close_up.get_lines() if len(line.get_xdata()) == 2] == [None, None]


def test_nothing_is_clipped_by_the_edge_even_with_a_long_name(calibration: Calibration) -> None:
    named = dataclasses.replace(calibration, robot="a_robot_with_a_very_long_name_and_a_payload_and_an_arm_version_2")

    assert_nothing_is_clipped(drawn(named))


def test_drawing_never_imports_pyplot(calibration: Calibration, tmp_path: Path) -> None:
    calibration.save(tmp_path / "result.json")
    program = [sys.executable, "-c", DRAW_IN_A_FRESH_PYTHON, str(tmp_path / "result.json"), str(tmp_path / "drawn")]
    subprocess.run(program, check=True, timeout=120)
    assert list((tmp_path / "drawn").glob("*.png"))
