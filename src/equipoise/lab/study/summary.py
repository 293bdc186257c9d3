"""Numbers of a Monte Carlo study as text and as JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from equipoise.json_form import to_json
from equipoise.lab.study.study import Study
from equipoise.lab.study.study_statistics import MethodSummary, Rate, Slope
from equipoise.simulation.effects import EffectSizes
from equipoise.user_file import write_file

SCHEMA = "equipoise.study-summary/1"

# Display units of sizes: unit, units per SI unit.
_BY_UNIT = {"rad": ("mrad", 1e3), "m": ("mm", 1e3), "s": ("ms", 1e3), "": ("%", 1e2)}
_UNITS = {
    **dict.fromkeys(("size_gyro_noise", "size_gyro_bias", "size_gyro_drift"), ("mrad/s", 1e3)),
    **{"payload_mass": ("kg", 1.0), "joint_zero_rms": ("mrad", 1e3), "foot_error_rms": ("mm", 1e3)},
    **{"imu_tilt_size": ("mrad", 1e3)},
}


def source_label(source: str) -> str:
    """Return the label of a column of error sizes."""
    return source.removeprefix("size_").replace("_", " ")


def source_unit(source: str) -> tuple[str, float]:
    """Return the display unit of a source, and the number of these units in one SI unit."""
    if source in _UNITS:
        return _UNITS[source]
    row = EffectSizes.row(source.removeprefix("size_"))
    return (f"1/({row.unit})", 1.0) if row.inverse else _BY_UNIT.get(row.unit, (row.unit, 1.0))


def slope_numbers(slope: Slope) -> tuple[float, float, str]:
    """Return a slope, its standard error and their unit for display."""
    unit, factor = source_unit(slope.source)
    return 1000 * slope.slope / factor, 1000 * slope.std / factor, f"mm per {unit}"


def summary_table(study: Study, summaries: Sequence[MethodSummary], slopes: Sequence[Slope]) -> dict[str, Any]:
    """Return the JSON form of a study's summary."""
    table = {"schema": SCHEMA, "study": study.to_dict(), "methods": to_json(summaries), "slopes": to_json(slopes)}
    return json.loads(json.dumps(table), parse_constant=lambda name: None)  # JSON has no infinities and no nan


def rate_text(rate: Rate) -> str:
    """Return a rate in percent with its 95 % interval."""
    lower, upper = rate.interval
    return f"{100 * rate.value:.1f} % ({100 * lower:.1f} to {100 * upper:.1f})"


def save_summary(folder: str | Path, table: dict[str, Any], markdown: str) -> list[Path]:
    """Write summary.json and summary.md; raises OutputError if they cannot be written."""
    paths = [Path(folder) / "summary.json", Path(folder) / "summary.md"]
    write_file(paths[0], json.dumps(table, indent=2, allow_nan=False) + "\n", "the summary ")
    write_file(paths[1], markdown, "the summary ")
    return paths
