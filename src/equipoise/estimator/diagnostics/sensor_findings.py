"""Errors of sensors and joints that a run found, in words: most of them can be fixed."""

from __future__ import annotations

from equipoise.estimator.problem import Posterior
from equipoise.estimator.unknown import Unknown
from equipoise.result.findings import SensorFinding

_SURE = 3.0  # standard deviations from zero


def sensor_findings(posterior: Posterior) -> list[SensorFinding]:
    """Every unknown that is reported and that the evidence says something of, the surest first."""
    findings = [
        SensorFinding(
            row.finding.format(each=label),
            value,
            std,
            row.message(label, value, std),
            _size(row, value) > max(_SURE * std, row.significant),
            row.unit,
        )
        for row in posterior.unknowns.rows
        if row.finding and row.name in posterior.informed
        for label, value, std in posterior.of_row(row)
    ]
    return sorted(findings, key=lambda finding: -abs(finding.value) / finding.std)


def _size(row: Unknown, value: float) -> float:
    """Return the size of an error; a negative value of what cannot be negative is none."""
    return value if row.nonnegative else abs(value)
