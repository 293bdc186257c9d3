"""Statistics of a study, on rows with given errors."""

import json
import math

import numpy as np
import pytest

from equipoise.json_form import to_json
from equipoise.lab.pages.study_page import method_blocks
from equipoise.lab.study import study_statistics as statistics
from equipoise.lab.study.rows import table_of
from equipoise.lab.study.study import SOURCES, Study
from equipoise.lab.study.study_statistics import Rate
from equipoise.lab.study.summary import summary_table
from equipoise.robot.inertial import COMPONENTS

TRUE = dict(zip([f"true_{name}" for name in COMPONENTS], [10.0, 0.01, 0.02, 0.0, 0.2, 0.5, 0.6, 0, 0, 0], strict=True))
SIZES = dict.fromkeys([f"size_{name}" for name in SOURCES], 0.0)
TRUTHS = {**TRUE, **{f"true_stance_effective_{axis}": 0.1 for axis in ("roll", "pitch", "yaw")}}


def row(trial, x=0.0, y=0.0, method="paper", std=None, **others):
    """Return the row of a calibration with planar CoM errors x and y [m]."""
    return {
        "trial": trial, "method": method, "status": "ok", "message": "", **TRUTHS, **SIZES, "payload_mass": 0.0,
        "estimated_com_x": TRUE["true_com_x"] + x, "estimated_com_y": TRUE["true_com_y"] + y,
        "std_com_x": std, "robot_time": 10.0 + trial, "cpu_time": 1.0, **others,
    }  # fmt: skip


def summarize(rows):
    return statistics.summarize(table_of(rows))


def slopes(rows, method):
    return statistics.slopes(table_of(rows), method)


def varied_sources(rows):
    return statistics.varied_sources(table_of(rows))


def failed(trial, kind="MotionError", method="paper", message="tipped"):
    return {
        "trial": trial,
        "method": method,
        "status": kind,
        "message": message,
        **TRUTHS,
        **SIZES,
        "payload_mass": 0.0,
    }


def test_bias_rms_and_percentile():
    errors = np.linspace(-3e-3, 5e-3, 41)
    (summary,) = summarize([row(trial, x) for trial, x in enumerate(errors)])
    found = summary.error("com_x")
    assert (found.unit, found.count) == ("mm", 41)
    assert found.bias == pytest.approx(1.0)
    assert found.rms == pytest.approx(1000 * np.sqrt(np.mean(errors**2)))
    assert found.percentile_95 == pytest.approx(1000 * np.sort(np.abs(errors))[38])
    assert summary.error("planar CoM").percentile_95 == found.percentile_95
    assert summary.error("com_z") is None
    assert summary.robot_time == 30.0
    assert (summary.trials, summary.failures, summary.within_5_mm.count) == (41, {}, 41)


def test_the_planar_error_is_the_distance():
    (summary,) = summarize([row(0, 3e-3, -3.9e-3), row(1, 3e-3, 4.1e-3)])
    assert summary.within_5_mm == Rate(1, 2)
    assert summary.error("planar CoM").bias == pytest.approx((np.hypot(3, 3.9) + np.hypot(3, 4.1)) / 2)


def test_mass_and_moments_are_in_percent():
    (summary,) = summarize([row(t, estimated_mass=10.5, estimated_Ixy=0.01, moment_roll=0.3) for t in range(3)])
    assert summary.error("mass").bias == pytest.approx(5)
    assert (summary.error("Ixy").unit, summary.error("Ixy").bias) == ("% of Ixx", pytest.approx(5))
    assert summary.error("I roll, whole").bias == pytest.approx(50)
    assert summary.error("I roll, no shanks").bias == pytest.approx(200)
    assert summary.error("I yaw, whole") is None


def test_coverage_is_the_share_of_intervals_that_contain_the_truth():
    off = [0.5, 0.6, 1.0, 1.8, 3.0]  # standard deviations
    (summary,) = summarize([row(trial, 1e-3 * factor, std=1e-3) for trial, factor in enumerate(off)])
    assert summary.error("com_x").coverage == {50: Rate(2, 5), 90: Rate(3, 5), 95: Rate(4, 5)}
    assert summary.error("com_y").coverage == {}


def test_calibrated_intervals_have_nominal_coverage():
    generator = np.random.default_rng(0)
    rows = [row(trial, 2e-3 * generator.standard_normal(), std=2e-3) for trial in range(2000)]
    (summary,) = summarize(rows)
    for level, rate in summary.error("com_x").coverage.items():
        assert rate.value == pytest.approx(level / 100, abs=0.035)


def test_wilsons_interval():
    assert Rate(8, 10).interval == pytest.approx((0.4901568, 0.9433191), abs=1e-6)
    assert Rate(0, 20).interval == pytest.approx((0.0, 0.1611301), abs=1e-6)
    assert Rate(20, 20).interval[1] == pytest.approx(1.0)
    assert Rate(0, 0).interval == (0.0, 1.0)
    assert math.isnan(Rate(0, 0).value)


def test_failures_are_not_within_5_mm_and_are_the_largest_errors():
    rows = [row(trial, 1e-3) for trial in range(95)] + [failed(trial) for trial in range(95, 100)]
    (summary,) = summarize(rows)
    assert summary.within_5_mm == Rate(95, 100)
    assert summary.failures == {"MotionError": 5}
    assert summary.error("com_x").percentile_95 == pytest.approx(1.0)  # one in twenty
    assert summary.error("com_x").bias == pytest.approx(1.0)
    (worse,) = summarize([*rows, failed(100)])
    assert math.isinf(worse.error("com_x").percentile_95)
    assert worse.error("com_x").count == 95


def test_a_summary_of_failures_only():
    (summary,) = summarize([failed(0), failed(1, "ValueError", message="Traceback\n  line\nValueError: no")])
    assert (summary.within_5_mm, summary.errors) == (Rate(0, 2), ())
    assert summary.reasons == {"MotionError": "trial 0: tipped", "ValueError": "trial 1: ValueError: no"}
    page = str(method_blocks(summary))
    assert "nan" not in page
    assert "ValueError, the first in trial 1: ValueError: no" in page


def test_methods_have_separate_summaries_and_json_has_no_infinities():
    rows = [row(0), row(1), failed(0, method="static"), row(1, 0.02, method="static")]
    summaries = summarize(rows)
    assert [(summary.method, summary.within_5_mm) for summary in summaries] == [
        ("paper", Rate(2, 2)),
        ("static", Rate(0, 2)),
    ]
    table = summary_table(Study(), summaries, [])
    text = json.dumps(table, allow_nan=False)
    assert json.loads(text)["methods"][1]["errors"][0]["percentile_95"] is None
    assert to_json(summaries)[0]["within_5_mm"]["interval_95"][1] == 1.0
    assert "more than 5 % failed" in str(method_blocks(summaries[1]))


def varied(count, slope_by_source, constant=1e-3, seed=0):
    """Return rows whose planar error is the root sum of squares of sources of random size."""
    generator = np.random.default_rng(seed)
    rows = []
    for trial in range(count):
        sizes = {source: unit * generator.uniform(0, 2) for source, (_, unit) in slope_by_source.items()}
        rms = np.sqrt(constant**2 + sum((slope_by_source[source][0] * size) ** 2 for source, size in sizes.items()))
        x, y = rms / np.sqrt(2) * generator.standard_normal(2)
        rows.append(row(trial, x, y, **sizes))
    return rows


def test_slopes_are_recovered():
    known = {"size_joint_offset": (0.5, 5e-3), "size_imu_tilt": (0.2, 5e-3), "size_torque_gain": (0.1, 0.03)}
    rows = varied(2000, known)
    assert varied_sources(rows) == [f"size_{name}" for name in SOURCES if f"size_{name}" in known]
    found = {slope.source: slope for slope in slopes(rows, "paper")}
    assert set(found) == set(known)
    for source, (slope, unit) in known.items():
        assert abs(found[source].slope - slope) < 3 * found[source].std, source
        assert found[source].std * unit < 0.5e-3


def test_a_source_without_effect_has_a_slope_near_zero():
    found = {
        s.source: s
        for s in slopes(varied(2000, {"size_joint_offset": (0.5, 5e-3), "size_leg_mass": (0, 0.03)}), "paper")
    }
    assert found["size_leg_mass"].slope * 0.03 < 0.5e-3
    assert found["size_leg_mass"].slope < 3 * found["size_leg_mass"].std + 1e-12


def test_too_few_rows_and_constant_sizes_give_no_slopes():
    known = {"size_joint_offset": (0.5, 5e-3), "size_imu_tilt": (0.2, 5e-3)}
    assert slopes(varied(19, known), "paper") == []
    assert len(slopes(varied(20, known), "paper")) == 2
    assert slopes(varied(200, known), "static") == []
    assert slopes([row(trial, 1e-3) for trial in range(100)], "paper") == []
    assert slopes([failed(trial) for trial in range(100)], "paper") == []


def test_the_payload_is_a_source_only_with_others():
    rows = varied(100, {"size_joint_offset": (0.5, 5e-3)})
    masses = [entry | {"payload_mass": 0.1 * entry["trial"]} for entry in rows]
    assert varied_sources(masses) == ["size_joint_offset", "payload_mass"]
    assert varied_sources([row(t, payload_mass=0.1 * t) for t in range(9)]) == []
