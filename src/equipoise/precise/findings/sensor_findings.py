"""What was found wrong with the sensors, in words: people can fix most of it."""

from __future__ import annotations

from equipoise.precise.posterior import Posterior
from equipoise.result.findings import SensorFinding

_SURE = 3.0  # standard deviations from zero


def sensor_findings(posterior: Posterior) -> list[SensorFinding]:
    """Every unknown that is reported and that the evidence says something of, the surest first."""
    unknowns = posterior.unknowns
    findings = [
        SensorFinding(
            row.finding.format(each=label),
            float(value),
            float(deviation),
            row.sentence(label, float(value), float(deviation)),
            bool(abs(value) > _SURE * deviation and abs(value) > row.notable),
        )
        for row in unknowns.rows
        if row.finding and row.name in posterior.informed
        for label, value, deviation in zip(
            unknowns.labels(row), unknowns.value(posterior.x, row.name), posterior.deviation(row.name), strict=True
        )
    ]
    return sorted(findings, key=lambda finding: -abs(finding.value) / finding.deviation)
