"""Estimated errors of sensors and joints, with messages on how to fix them."""

from __future__ import annotations

from equipoise.estimator.problem import Posterior
from equipoise.result.findings import SensorFinding

_SIGNIFICANT = 3.0  # standard deviations from zero


def sensor_findings(posterior: Posterior) -> list[SensorFinding]:
    """Return the findings of all reported parameters that an equation depends on, by decreasing value over std.

    A negative value of a nonnegative parameter is not significant.
    """
    findings = [
        SensorFinding(
            row.finding.format(each=label),
            value,
            std,
            row.message(label, value, std),
            (value if row.nonnegative else abs(value)) > max(_SIGNIFICANT * std, row.significant),
            row.unit,
        )
        for row in posterior.unknowns.rows
        if row.finding and row.name in posterior.informed
        for label, value, std in posterior.of_row(row)
    ]
    return sorted(findings, key=lambda finding: -abs(finding.value) / finding.std)
