"""Contents of the report, and the file."""

import dataclasses
import functools
import html
import json
import re
import zipfile
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from plotly.offline import get_plotlyjs

from equipoise import (
    Calibration,
    ComSearchSettings,
    calibrate,
    load_robot,
    nominal_stance,
    simulate,
)
from equipoise.errors import OutputError, SettingsError
from equipoise.figures.blocks import Cell, DataTable, Figure, number, short
from equipoise.figures.numbers import in_shown_unit, numbers, numbers_table
from equipoise.figures.plan_view import plan_view
from equipoise.lab.static.method import Static
from equipoise.paper.iterations import tried_offsets
from equipoise.report import contents as page_contents
from equipoise.report.comparison import comparison_contents
from equipoise.report.html import bar_places, block_html, typeset
from equipoise.report.page import page, save_comparison, save_report
from equipoise.report.trial_figures import narrowing
from equipoise.result.body import Body, InertiaTensor
from equipoise.result.calibration import ExcitationEstimate
from equipoise.result.statistics import ellipsoid_95
from equipoise.robot.inertial import COMPONENTS, InertialParameters

ROOT = Path(__file__).parents[2]
LARGEST = 8_000_000  # [B]
run_contents = functools.cache(page_contents.run_contents)  # a second for each result of the Bayesian method


@pytest.fixture(scope="module")
def bayesian(bayesian_run):
    return bayesian_run.result.with_truth(bayesian_run.truth)


@pytest.fixture(scope="module")
def paper(paper_result):
    return paper_result


@pytest.fixture(scope="module")
def static():
    robot = load_robot("unitree_a1")
    with simulate(robot, "ideal") as simulation:
        return calibrate(simulation.platform, robot, Static())


def blocks(contents, kind):
    """Return all blocks of a kind below the first screen."""
    return [block for section in contents.sections.values() for block in section if isinstance(block, kind)]


def figure_called(contents, title):
    (figure,) = (figure for figure in blocks(contents, Figure) if figure.title == title)
    return figure


def titles(contents):
    return list(contents.sections)


def legend(contents):
    return [block for block in contents.first if isinstance(block, str)]


def stored(text):
    """Return the figures of a page."""
    return json.loads(re.search(r"const figures = (.*?);\n", text).group(1))


# --- what is on it


def test_a_bayesian_run_shows_all_parts(bayesian):
    contents = run_contents(bayesian)
    assert titles(contents) == [
        "Held-out lifts", "Trials", "Residuals", "Sensors", "Uncertainty",
        "Other bodies", "Checks", "Provenance",
    ]  # fmt: skip
    figures = [figure.title for figure in blocks(contents, Figure)]
    for title in (
        "Prediction errors of held-out lifts",
        "Residual of each motion",
    ):
        assert title in figures
    assert len(contents.first[0].rows) == 10


def test_the_notes_state_frame_point_axes_and_stance(bayesian):
    frame, *_ = legend(run_contents(bayesian))
    assert frame == (
        "CoM from the origin of base link 'trunk', x forward, z up; inertia about the CoM, in the same axes; standing with "
        "its hips 0.320 m high. IMU: frame 'imu_link', at 0.0 0.0 0.0 mm in the base frame. Of 20 intervals one is "
        "expected to miss the truth."
    )


def test_a_failed_check_takes_the_headline(bayesian):
    checks = (dataclasses.replace(bayesian.checks[0], passed=False), *bayesian.checks[1:])
    failed = dataclasses.replace(bayesian, checks=checks, composite=bayesian.composite.doubted())
    (first,) = run_contents(failed).actions
    assert first.startswith(f"Doubtful: 1 of {len(checks)} checks failed. Do not use these numbers before ")
    assert "doubtful: a check failed" in legend(run_contents(failed))[1]
    assert "Doubtful" not in run_contents(bayesian).actions[0]


def test_missing_settings_are_shown_as_not_given(bayesian):
    given = bayesian.with_provenance(payload=None)
    rows = {row[0]: row[1] for block in blocks(run_contents(given), DataTable) for row in block.rows if len(row) == 2}
    assert (rows["payload"], rows["mass"]) == ("none", "not given")


def test_the_papers_method_shows_its_search(paper):
    contents = run_contents(paper)
    figures = [figure.title for figure in blocks(contents, Figure)]
    for title in (
        "Convergence of the search",
        "Excitation about yaw: joint torques",
    ):
        assert title in figures
    assert "does not estimate these parameters of the whole robot: mass, CoM z, Ixx" in contents.lead
    assert contents.actions[0].startswith("`paper` gives no intervals, so no difference ")


def test_the_static_method_omits_parameters_without_estimate(static):
    contents = run_contents(static)
    assert titles(contents) == ["Trials", "Provenance"]
    assert [row[0] for row in contents.first[0].rows] == ["mass [kg]", "CoM x [mm]", "CoM y [mm]"]
    (feet,) = (trace for trace in contents.first[-2].data if trace["name"] == "feet")
    assert feet["text"] == ["FL", "FR", "RL", "RR"]


def test_a_report_from_json(bayesian, tmp_path):
    bayesian.save(tmp_path / "result.json")
    contents = run_contents(Calibration.load(tmp_path / "result.json"))
    assert titles(contents) == [
        "Held-out lifts", "Trials", "Residuals", "Sensors", "Uncertainty", "Other bodies", "Checks", "Provenance",
    ]  # fmt: skip
    assert contents.first[0] == run_contents(bayesian).first[0]
    assert [block.title for block in contents.first if isinstance(block, Figure)] == ["Around the centre of mass"]


def test_the_page_begins_with_significant_differences_and_the_command(bayesian):
    first, effects, command = run_contents(bayesian, "runs/a b").actions
    assert first.startswith("Update the model file of your controller. The whole robot differs from it significantly")
    assert all(
        " than in the file: in a convex MPC, " in effect for effect in effects if effect.startswith("The CoM is ")
    )
    assert 1 <= len(effects) <= 3
    assert "`equipoise export runs/a b --to urdf`" in command


def moved(result, **changes):
    """Return the result with model values that differ from the estimate by -changes, in SI units, and small stds."""
    values = dict(zip(COMPONENTS, result.composite.values, strict=True))
    model = InertialParameters.from_components(np.array([values[name] - changes.get(name, 0.0) for name in COMPONENTS]))
    body = Body.complete(result.composite.parameters(), 1e-6 * np.diag(result.composite.values**2), None, model)
    return dataclasses.replace(result, composite=body)


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("com_x", 8e-3, "The CoM is 8.0 +- 0.0 mm further forward than in the file"),
        ("com_x", -8e-3, "further back"),
        ("com_y", 8e-3, "further left"),
        ("com_y", -8e-3, "further right"),
    ],
)
def test_a_displaced_com_tips_the_robot_as_its_foot_forces_do(name, change, words, bayesian):
    """The forces balance about the model's CoM; their moment about the true one is -d x F."""
    result = moved(bayesian, **{name: change})
    (effect,) = run_contents(result).actions[1]
    shift = change * np.eye(3)["xyz".index(name[-1])]
    roll, pitch, _ = np.cross(-shift, [0.0, 0.0, 9.81 * result.composite.mass.value])
    tips = {(0, 1): "nose down", (0, -1): "nose up", (-1, 0): "to the left", (1, 0): "to the right"}
    assert words in effect
    assert f"leave {np.hypot(roll, pitch):.2f} Nm, {tips[np.sign(roll), np.sign(pitch)]}, to feedback" in effect


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        (
            "mass",
            -0.5,
            "0.50 +- 0.03 kg less mass than in the file: a convex MPC commands 4.9 N too much vertical force",
        ),
        (
            "com_z",
            5e-3,
            "mm higher than in the file: in a convex MPC, each m/s2 of horizontal acceleration leaves 0.07 Nm",
        ),
        ("Iyy", 0.1, "larger than in the file: an MPC's moment in pitch accelerates the robot"),
        ("Ixz", -0.1, "smaller than in the file: in an MPC, each 10 rad/s2 in roll leaves 1.00 Nm in yaw to feedback"),
    ],
)
def test_each_difference_has_its_effect(name, change, words, bayesian):
    (effect,) = run_contents(moved(bayesian, **{name: change})).actions[1]
    assert words in effect


def test_the_largest_three_differences_are_explained_and_others_named(bayesian):
    many = moved(bayesian, mass=1.0, com_x=0.01, com_y=0.008, com_z=0.006, Iyy=0.05)
    first, effects, _ = run_contents(many).actions
    assert effects[0].startswith("The robot has 1.00 +- ")
    assert len(effects) == 3
    assert first.endswith("; also CoM z, Iyy:")


def test_negligible_and_insignificant_differences_keep_the_model_file(bayesian):
    small = moved(bayesian, mass=0.1, com_x=1.9e-3, Iyy=0.01)  # of 13 kg
    assert run_contents(small).actions[0].startswith("The model file needs no change: ")
    wide = moved(bayesian, com_x=3e-3)
    stds = np.diag([*4 * [2e-3], *6 * [1e-2]]) ** 2
    wide = dataclasses.replace(
        wide, composite=Body.complete(wide.composite.parameters(), stds, None, wide.composite.model)
    )
    assert run_contents(wide).actions[0].startswith("The model file needs no change: ")
    just = moved(bayesian, com_x=2.2e-3)
    assert "2.2 +- " in run_contents(just).actions[1][0]


def test_unidentified_base_parameters_are_named_in_place_of_the_command(bayesian):
    ten = [dataclasses.replace(one, verdict="not identified") if one.name == "Izz" else one for one in bayesian.base]
    base = dataclasses.replace(bayesian.base, inertia=InertiaTensor(*ten[4:]))
    *_, command = run_contents(dataclasses.replace(bayesian, base=base)).actions
    assert command.startswith("Not identified for the base link: Izz. Increase `--duration`")


def test_a_saved_report_names_its_run(bayesian, tmp_path):
    (tmp_path / "run.json").write_text("{}")
    assert f"equipoise export {tmp_path} --to urdf" in save_report(bayesian, tmp_path).read_text(encoding="utf-8")
    elsewhere = save_report(bayesian, tmp_path / "other.html").read_text(encoding="utf-8")
    assert "equipoise export RUN --to urdf" in elsewhere


def test_the_lead_states_assumptions(bayesian):
    assert "Assumed" not in run_contents(dataclasses.replace(bayesian, assumptions=())).lead
    assumed = dataclasses.replace(bayesian, assumptions=("no cable pulls", "the legs are light"))
    assert run_contents(assumed).lead == "Assumed: no cable pulls; the legs are light."


def test_alerts_are_failed_checks_or_warnings(bayesian, paper):
    failed = dataclasses.replace(bayesian.checks[0], passed=False)
    contents = run_contents(dataclasses.replace(bayesian, checks=(failed,), warnings=("unused",)))
    assert contents.alerts == [(f"Check failed: {failed.name}", failed.message)]
    contents = run_contents(dataclasses.replace(paper, warnings=("the legs sag",)))
    assert contents.alerts == [("Warning", "the legs sag")]


# --- the numbers


def test_numbers_are_the_results_in_the_terminals_units(bayesian):
    table = numbers_table(numbers(bayesian), "")
    mass, com_x, *_ = ({head: str(cell) for head, cell in zip(table.columns, row, strict=True)} for row in table.rows)
    found = bayesian.composite.com_in_base.x
    assert (com_x["parameter"], com_x["verdict"]) == ("CoM x [mm]", found.verdict)
    assert com_x["|95 % +-"] == f"{1960 * found.std:.2f}"
    error = com_x["|error"].removesuffix(" (!)")
    assert error == f"{1000 * (found.value - bayesian.truth.composite.com[0]):+.2f}"
    assert mass["|change"] == f"{bayesian.composite.mass.value - bayesian.nominal.composite.mass:+.3f}"


def test_a_bar_keeps_the_order_of_its_values(bayesian):
    for one in numbers(bayesian):
        places = bar_places(one)
        assert 0 <= places["lower"] < places["value"] < places["upper"] <= 1
        for kind in ("model", "truth"):
            assert 0 <= places[kind] <= 1
            assert (places[kind] < places["value"]) == (getattr(one, kind) < one.value)


@pytest.mark.parametrize(
    ("value", "form", "text"),
    [
        (None, ".2f", "-"),
        (-0.001, ".2f", "0.00"),
        (-0.001, "+.2f", "+0.00"),
        (-1.5, ".1f", "-1.5"),
        (2.0, "+.1f", "+2.0"),
    ],
)
def test_numbers_have_no_minus_zero(value, form, text):
    assert number(value, 1, form) == text


@pytest.mark.parametrize(
    ("text", "page"),
    [
        ("-1.5 +- 0.2", "\u22121.5 \u00b1 0.2"),
        ("2026-11-26, runs/go-2, 1e-5, --kp", "2026-11-26, runs/go-2, 1e-5, --kp"),
        ("<b>", "&lt;b&gt;"),
    ],
)
def test_pages_have_true_minus_signs_and_no_tags_of_a_users(text, page):
    assert typeset(text) == page


def test_code_in_a_paragraph_or_a_list_is_set_as_code():
    assert block_html("`lab <x>` -1") == "<p><code>lab &lt;x&gt;</code> \u22121</p>"
    assert block_html(("`a`", "one ` alone")) == "<ul><li><code>a</code></li><li>one ` alone</li></ul>"


def test_curves_are_rounded_and_gaps_are_none():
    assert short([1.234567, np.nan, np.inf, 0.0]) == [1.235, None, None, 0.0]


# --- trials


def test_bounds_narrow_to_those_of_the_support_line(paper):
    for diagonal, line in paper.support_lines.items():
        start = ComSearchSettings().bracket(nominal_stance(paper.robot_model))
        lower, upper = narrowing(tried_offsets(paper, diagonal), start)
        assert np.all(np.diff(lower) >= 0)
        assert np.all(np.diff(upper) <= 0)
        assert (lower[-1], upper[-1]) == (line.lower, line.upper)


def test_excitations_are_shown_as_measured_and_as_fitted(paper):
    figures = {figure.title: figure for figure in blocks(run_contents(paper), Figure)}
    for axis, fit in paper.evidence.fits.items():
        velocity, torque = (figures[f"Excitation about {axis}: {name}"] for name in ("gyroscope", "joint torques"))
        for figure, curves in (
            (velocity, (fit.angular_velocity, fit.sinusoid.value(fit.time))),
            (torque, (fit.torque, fit.fitted_torque)),
        ):
            assert [trace["y"] for trace in figure.data] == [short(curve) for curve in curves]
        assert f"{fit.sinusoid.frequency:.2f} Hz" in velocity.caption
        assert f"I = {fit.inertia:.4f} kg m2, C = {fit.damping:.3f} Nm s/rad" in torque.caption


def test_excitation_notes_are_listed(paper):
    fits = {axis: fit for axis, fit in paper.evidence.fits.items() if axis != "roll"}
    skipped, doubt = "skipped, not possible with all feet on the floor", "the smallest foot load is 0.3 N"
    excitations = {
        **paper.excitations,
        "roll": ExcitationEstimate(None, None, note=skipped),
        "pitch": dataclasses.replace(paper.excitations["pitch"], note=doubt),
    }
    evidence = dataclasses.replace(paper.evidence, fits=fits)
    contents = run_contents(dataclasses.replace(paper, excitations=excitations, evidence=evidence))
    assert not any(figure.title.startswith("Excitation about roll") for figure in blocks(contents, Figure))
    notes = [item for block in blocks(contents, tuple) for item in block]
    assert {f"roll: {skipped}", f"pitch: {doubt}"} <= set(notes)


def test_every_estimated_motion_has_a_normalized_residual(bayesian):
    normalized_residuals = figure_called(run_contents(bayesian), "Residual of each motion")
    read = [number for number, trial in enumerate(bayesian.trials, start=1) if trial.normalized_residual is not None]
    assert sorted(number for bars in normalized_residuals.data for number in bars["x"]) == read


def test_hollow_bars_are_explained(bayesian):
    figure = figure_called(run_contents(bayesian), "Residual of each motion")
    assert all(trial.note is None for trial in bayesian.trials if trial.normalized_residual is not None)
    assert "Hollow" not in figure.caption
    index = next(index for index, trial in enumerate(bayesian.trials) if trial.normalized_residual is not None)
    left_out = dataclasses.replace(bayesian.trials[index], note="left out: it does not fit the others")
    trials = (*bayesian.trials[:index], left_out, *bayesian.trials[index + 1 :])
    figure = figure_called(run_contents(dataclasses.replace(bayesian, trials=trials)), "Residual of each motion")
    assert figure.caption.endswith("Hollow bars: motions excluded from the estimate.")
    fills = [fill for bars in figure.data for fill in bars["marker"]["color"]]
    assert fills.count("rgba(0,0,0,0)") == 1


def test_hatching_is_of_kinds_of_motions_alone(bayesian):
    contents = run_contents(bayesian)
    bars = figure_called(contents, "Residual of each motion").data
    patterns = {trace["name"]: trace["marker"]["pattern"]["shape"] for trace in bars}
    assert patterns == {"lift": "", "stance motion": "/"}
    others = [figure for figure in blocks(contents, Figure) if "residual" not in figure.title.lower()]
    assert not any("pattern" in trace.get("marker", {}) for figure in others for trace in figure.data)


def test_caption_explains_the_level_of_stance_motions(bayesian):
    caption = figure_called(run_contents(bayesian), "Residual of each motion").caption
    assert "Stance motions: the expected noise is a fixed allowance" in caption
    lifts = tuple(trial for trial in bayesian.trials if trial.kind == "lift")
    alone = run_contents(dataclasses.replace(bayesian, trials=lifts))
    assert figure_called(alone, "Residual of each motion").caption == "1: the residual equals the expected noise."


# --- sensors and checks


def test_angles_and_positions_have_axes_of_their_own(bayesian):
    contents = run_contents(bayesian)
    angles, position = (figure_called(contents, name) for name in ("Joint offsets and IMU orientation", "IMU position"))
    assert [figure.layout["xaxis"]["title"]["text"] for figure in (angles, position)] == ["error [deg]", "error [mm]"]
    found = {finding.name: finding.value for finding in bayesian.sensors}
    assert not any("position" in name for name in angles.data[0]["y"])
    names = [name.removeprefix("<b>").removesuffix("</b>") for name in position.data[0]["y"]]
    assert sorted(names) == ["IMU position x", "IMU position y", "IMU position z"]
    assert position.data[0]["x"] == short((1000 * found[name] for name in names), 6)


def test_significant_sensor_errors_are_bold(bayesian):
    other = dataclasses.replace(
        bayesian.sensors[0], name="servo_hl_0 offset", value=0.2, std=0.01, significant=True, unit="rad"
    )
    changed = dataclasses.replace(
        bayesian, sensors=(other, dataclasses.replace(other, name="servo_hl_1 offset", significant=False))
    )
    figure = figure_called(run_contents(changed), "Joint offsets and IMU orientation")
    assert figure.data[0]["y"] == ["<b>servo_hl_0 offset</b>", "servo_hl_1 offset"]
    assert figure.caption.endswith("Bold: significant errors; correct them.")


def test_a_passed_check_reads_as_passed(bayesian):
    passed = {check.name: check.message for check in bayesian.checks if check.passed}
    assert len(passed) > 10
    assert not [message for message in passed.values() if re.search(r"\bwould\b|elsewhere|seems", message)]


def test_the_caption_has_the_digits_of_the_table(bayesian):
    close_up = next(
        block for block in run_contents(bayesian).first if getattr(block, "title", "") == "Around the centre of mass"
    )
    x, y = (in_shown_unit(one, one.value) for one in numbers(bayesian)[1:3])
    assert close_up.caption.startswith(f"estimate x {x}, y {y} mm; ")


# --- the file


def test_the_page_is_one_small_file_that_names_no_other(bayesian, tmp_path):
    path = save_report(bayesian, tmp_path)
    text = path.read_text(encoding="utf-8")
    assert path == tmp_path / "report.html"
    assert path.stat().st_size < LARGEST
    assert text.count(get_plotlyjs()) == 1
    ours = text.replace(get_plotlyjs(), "")
    assert not re.search(r"https?://", ours)
    assert not re.search(r"<(link|img|iframe)\b|\bsrc=|@import|url\((?!#)", ours)
    assert "default-src 'none'" in ours


def test_the_page_holds_every_figure_and_every_row(bayesian):
    contents = run_contents(bayesian)
    text = page(contents)
    first = [block for block in contents.first if isinstance(block, Figure)]
    assert [data for data, _ in stored(text)] == [figure.data for figure in (*first, *blocks(contents, Figure))]
    tables = [contents.first[0], *blocks(contents, DataTable)]
    assert text.count("<tr>") == sum(1 + len(table.rows) for table in tables)


def test_no_name_ends_the_script_that_holds_it(static):
    name = "</script><script>alert(1)</script> {{plotly}}"
    contents = run_contents(dataclasses.replace(static, robot=name))
    text = page(contents)
    assert text.count("<script") == page(run_contents(static)).count("<script")
    assert f"<title>{html.escape(name)}: equipoise</title>" in text
    assert f"<h1>{html.escape(name)}</h1>" in text


@pytest.mark.parametrize("path", ["file/report.html", "file/inside/report.html"])
def test_a_report_that_cannot_be_written_is_an_output_error(static, tmp_path, path):
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    with pytest.raises(OutputError, match="cannot write the report"):
        save_report(static, tmp_path / path)


def test_the_package_that_is_built_has_the_page(tmp_path):
    from hatchling.builders.wheel import WheelBuilder  # noqa: PLC0415 - a build tool

    (wheel,) = WheelBuilder(str(ROOT)).build(directory=str(tmp_path), versions=["standard"])
    packed = {name for name in zipfile.ZipFile(wheel).namelist() if "report/page/" in name}
    there = {f"equipoise/report/page/{file.name}" for file in files("equipoise.report").joinpath("page").iterdir()}
    assert packed == there
    assert {Path(name).suffix for name in packed} == {".html", ".css"}


# --- comparing


def test_the_close_up_contains_all_ellipses(bayesian):
    wide = dataclasses.replace(bayesian.composite, covariance=16 * bayesian.composite.covariance)
    com = wide.com_in_base
    there = com.x.value + 2 * ellipsoid_95(wide.covariance[1:3, 1:3])[1][1]
    moved = dataclasses.replace(com, x=dataclasses.replace(com.x, value=there))
    before = dataclasses.replace(bayesian, composite=wide)
    after = dataclasses.replace(bayesian, composite=dataclasses.replace(wide, com_in_base=moved))
    seen = plan_view({"before": before, "after": after})
    for mark in seen.marks:
        assert np.abs(mark.ellipse - seen.centre).max() < seen.half_width


def test_a_difference_has_the_combined_interval(bayesian, static):
    other = dataclasses.replace(bayesian, composite=bayesian.composite)
    contents = comparison_contents({"before": bayesian, "after": other})
    table = next(block for block in blocks(contents, DataTable) if block.title == "after minus before")
    half = numbers(bayesian)[0].half_width
    assert table.rows[0] == ["mass [kg]", Cell("+0.000"), f"{np.sqrt(2) * half:.3f}", "within the interval"]
    assert len([block for block in contents.first if isinstance(block, Figure)]) == 2
    mixed = comparison_contents({"bayesian": bayesian, "static": static})
    table = next(block for block in blocks(mixed, DataTable) if block.title == "static minus bayesian")
    assert [row[0] for row in table.rows] == ["mass [kg]", "CoM x [mm]", "CoM y [mm]"]
    both = np.hypot(half, static.composite.mass.half_width)
    assert table.rows[0][2:] == [f"{both:.3f}", "within the interval"]


def test_differences_in_provenance_are_bold(bayesian):
    other = bayesian.with_provenance(seed=9)
    contents = comparison_contents({"a": bayesian.with_provenance(seed=8), "b": other})
    (table,) = (block for block in blocks(contents, DataTable) if block.title.startswith("Provenance"))
    rows = {row[0]: row[1:] for row in table.rows}
    assert rows["seed"] == [Cell("8", "strong"), Cell("9", "strong")]
    assert all(cell.tone == "" for cell in rows["method"])


def test_different_robots_are_called_so(bayesian):
    contents = comparison_contents({"a": bayesian, "b": dataclasses.replace(bayesian, robot="other")})
    assert contents.lead.startswith("The runs are of 2 different robots")


def test_one_run_is_no_comparison(bayesian, tmp_path):
    with pytest.raises(SettingsError, match="1 runs cannot be compared; give at least two"):
        save_comparison({"alone": bayesian}, tmp_path / "comparison.html")
