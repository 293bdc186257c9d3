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
from matplotlib.patches import Circle
from matplotlib.text import Text

from equipoise import Calibration, Paper, calibrate, load_robot
from equipoise.errors import NotEstimatedError, OutputError
from equipoise.paper.evidence import SearchEvidence
from equipoise.pictures.files import save_pictures
from equipoise.pictures.search import draw_search
from equipoise.pictures.sway import draw_sways
from equipoise.result.calibration import SwayEstimate
from equipoise.robot.model import LEG_NAMES
from equipoise.simulation.simulation import simulate

pytestmark = pytest.mark.usefixtures("coarse_engine")

DRAW_IN_A_FRESH_PYTHON = """
import sys
from equipoise import Paper, calibrate, load_robot
from equipoise.pictures.files import save_pictures
from equipoise.simulation.simulation import simulate

robot = load_robot("unitree_a1")
with simulate(robot, "ideal") as simulation:
    save_pictures(calibrate(simulation.platform, robot, Paper()), sys.argv[1])
assert "matplotlib.pyplot" not in sys.modules
"""


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    robot = load_robot("unitree_a1")
    with simulate(robot, "ideal") as simulation:
        return calibrate(simulation.platform, robot, Paper()).with_truth(simulation.truth)


@pytest.fixture(scope="module")
def without_roll(calibration: Calibration) -> Calibration:
    assert isinstance(calibration.evidence, SearchEvidence)
    fits = {axis: fit for axis, fit in calibration.evidence.fits.items() if axis != "roll"}
    note = "skipped, planted feet do not allow it: " + "the leg is too short or lacks a joint, " * 4 + "and so on"
    return dataclasses.replace(
        calibration,
        sways={**calibration.sways, "roll": SwayEstimate(None, None, note=note)},
        evidence=dataclasses.replace(calibration.evidence, fits=fits),
    )


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


def test_pictures_are_written_as_png_files_of_a_readable_size(calibration: Calibration, tmp_path: Path) -> None:
    paths = save_pictures(calibration, tmp_path / "new" / "folder")

    assert [path.name for path in paths] == ["search.png", "sway.png"]
    for path in paths:
        content = path.read_bytes()
        width, height = struct.unpack(">II", content[16:24])
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
        save_pictures(calibration, tmp_path / folder)


def test_both_views_mark_the_com_as_found_as_it_is_and_as_modelled(calibration: Calibration) -> None:
    assert calibration.truth is not None
    found = calibration.composite.com_in_base.values[:2]

    for axes in draw_search(calibration).axes:
        np.testing.assert_allclose(marked(axes, "+"), found * 1000)
        np.testing.assert_allclose(marked(axes, "o"), calibration.truth.composite.com[:2] * 1000)
        np.testing.assert_allclose(marked(axes, "D"), calibration.nominal.composite.com[:2] * 1000)


def test_the_search_names_the_robot_the_method_the_result_and_the_error(calibration: Calibration) -> None:
    assert calibration.truth is not None
    x, y = calibration.composite.com_in_base.values[:2] * 1000
    error = np.hypot(*(np.array([x, y]) - calibration.truth.composite.com[:2] * 1000))
    lifts = sum(trial.kind == "lift" for trial in calibration.trials)

    shown = "\n".join(texts(draw_search(calibration)))

    assert "unitree_a1" in shown
    assert 4 <= lifts < len(calibration.trials)  # two bounds on either diagonal at least, and sways are no lifts
    assert f"method paper, feet measured, {lifts} lift trials" in shown
    assert f"x = {x:.1f} mm, y = {y:.1f} mm" in shown
    assert f"error {error:.1f} mm" in shown


def test_the_search_is_seen_from_above_with_named_feet(calibration: Calibration) -> None:
    assert isinstance(calibration.evidence, SearchEvidence)
    overview = draw_search(calibration).axes[0]
    feet = calibration.evidence.feet_in_base[:, :2] * 1000

    right, left = sorted(overview.get_xlim())
    assert overview.get_xlim() == (left, right), "left is to the left"
    assert overview.get_ylim()[0] < overview.get_ylim()[1], "forward is up"
    discs = [patch for patch in overview.patches if isinstance(patch, Circle)]
    np.testing.assert_allclose([disc.center for disc in discs], feet[:, ::-1])
    assert all(disc.get_radius() == pytest.approx(20.0) for disc in discs)
    names = [text for text in overview.texts if text.get_text() in LEG_NAMES]
    assert [name.get_text() for name in names] == list(LEG_NAMES)


def test_every_trial_has_a_line_and_verdicts_look_different(calibration: Calibration) -> None:
    zoom = draw_search(calibration).axes[1]
    lifts = [trial for trial in calibration.trials if trial.kind == "lift"]

    lines = [line for line in zoom.get_lines() if line.get_alpha() is not None]

    assert len(lines) == len(lifts)
    for line, lift in zip(lines, lifts, strict=True):
        assert line.is_dashed() == (lift.verdict != "forward")
    assert lines[0].get_alpha() == pytest.approx(0.35)
    assert lines[-1].get_alpha() == pytest.approx(1.0)


def test_the_found_support_lines_cross_at_the_com(calibration: Calibration) -> None:
    figure = draw_search(calibration)
    for axes in figure.axes:
        com = marked(axes, "+")
        thickest = sorted(axes.get_lines(), key=lambda line: line.get_linewidth() * (line.get_zorder() == 4))[-2:]
        for line in thickest:
            (y_a, y_b), (x_a, x_b) = np.asarray(line.get_data(), dtype=float)
            area = (x_b - x_a) * (com[1] - y_a) - (y_b - y_a) * (com[0] - x_a)
            assert abs(area) / np.hypot(x_b - x_a, y_b - y_a) < 1e-6


def test_a_result_without_truth_shows_no_error(calibration: Calibration) -> None:
    figure = draw_search(calibration.with_truth(None))

    assert not any("error" in text or "truth" in text for text in texts(figure))


def test_an_error_of_many_centimetres_stays_in_the_zoom(calibration: Calibration) -> None:
    truth = calibration.truth
    assert truth is not None
    far = dataclasses.replace(truth.composite, com=truth.composite.com + [0.06, 0.02, 0.0])

    zoom = draw_search(calibration.with_truth(dataclasses.replace(truth, composite=far))).axes[1]

    up, across = marked(zoom, "o")
    assert zoom.get_ylim()[0] < up < zoom.get_ylim()[1]
    assert zoom.get_xlim()[1] < across < zoom.get_xlim()[0]


def test_the_search_is_drawn_without_the_robot_model(calibration: Calibration) -> None:
    assert "FL" in texts(draw_search(dataclasses.replace(calibration, robot_model=None)))


def test_sways_show_measured_and_fitted_curves_with_numbers(calibration: Calibration) -> None:
    assert isinstance(calibration.evidence, SearchEvidence)
    figure = draw_sways(calibration)

    assert len(figure.axes) == 6
    for row, (axis, fit) in enumerate(calibration.evidence.fits.items()):
        velocity, torque = figure.axes[2 * row : 2 * row + 2]
        for axes, curves in (
            (velocity, (fit.angular_velocity, fit.sinusoid.value(fit.time))),
            (torque, (fit.torque, fit.fitted_torque)),
        ):
            for line, curve in zip(axes.get_lines(), curves, strict=True):
                np.testing.assert_array_equal(line.get_ydata(), curve)
        title = velocity.get_title(loc="left")
        assert title.startswith(f"{axis}:")
        assert f"I = {fit.inertia:.4g} kg m²" in title
        assert f"C = {fit.damping:.3g} N m s/rad" in title
        assert f"frequency = {fit.sinusoid.frequency:.3f} Hz" in title


def test_a_skipped_axis_says_why(without_roll: Calibration) -> None:
    figure = draw_sways(without_roll)

    assert without_roll.sways["roll"].note in texts(figure)
    assert len(figure.axes) == 5
    assert_nothing_is_clipped(figure)


def test_a_doubt_about_a_sway_stands_above_it(calibration: Calibration) -> None:
    doubt = "a foot carries only 0.3 N of 30.5 N at the lightest"
    sways = {**calibration.sways, "pitch": dataclasses.replace(calibration.sways["pitch"], note=doubt)}

    figure = draw_sways(dataclasses.replace(calibration, sways=sways))

    assert doubt in figure.axes[2].get_title(loc="left")


def test_nothing_is_clipped_by_the_edge_even_with_a_long_name(calibration: Calibration) -> None:
    named = dataclasses.replace(calibration, robot="a_robot_with_a_very_long_name_and_a_payload_and_an_arm_version_2")

    assert_nothing_is_clipped(draw_search(named))
    assert_nothing_is_clipped(draw_sways(named))


def test_a_result_from_a_json_file_says_what_is_missing(calibration: Calibration, tmp_path: Path) -> None:
    calibration.save(tmp_path / "result.json")
    loaded = Calibration.load(tmp_path / "result.json")

    with pytest.raises(NotEstimatedError, match="open the run folder"):
        draw_search(loaded)
    with pytest.raises(NotEstimatedError, match="open the run folder"):
        draw_sways(loaded)


def test_drawing_never_imports_pyplot(tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-c", DRAW_IN_A_FRESH_PYTHON, str(tmp_path)], check=True, timeout=120)
