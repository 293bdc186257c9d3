"""Payload from the log of a robot that walks, against a prior run or the model file."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace

from equipoise.bayesian.method import BayesianMethod
from equipoise.calibration.payload_measurement import PayloadMeasurement, measure_payload
from equipoise.errors import RecordingError, SettingsError
from equipoise.estimator.measurements.scale_reading import check_mass_of
from equipoise.logs.finding import LogFinding
from equipoise.logs.mass_ratio import mass_by_ratio
from equipoise.logs.offline import LogReport, estimate_segments, read_segments
from equipoise.logs.raw_log import Log
from equipoise.result.shown import called
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance

_MOST_WALKS = 12  # of 2 s: model errors exceed the noise after 20 s
# Largest half widths of an answer: of the payload's mass, and of its place on an A1 [m].
_MASS_WITHIN, _PLACE_WITHIN = 0.1, 10e-3


def measure_payload_in_log(
    robot: RobotModel, log: Log, method: BayesianMethod, bare: Log | None = None
) -> tuple[PayloadMeasurement, LogReport]:
    """Measure the payload in a log against the prior run of the method, or, without one, against the model file.

    The message names what the log does not determine: the mass within 10 % of the payload's, and its place within 10 mm on an
    A1 (half widths of 95 % intervals).

    Args:
        bare: log of a walk of the robot as it was in the prior run, in place of a mass from a scale.

    Raises:
        RecordingError: nothing in a log can be used, or its sensors are not plausible.
        SettingsError: the prior run is of another robot, or missing; a mass does not fit the robot, or is given with `bare`.
    """
    if bare is not None and (method.prior_run is None or method.mass is not None):
        raise SettingsError("a bare log replaces a scale after a prior run: give a prior run, and no mass")
    if method.mass is not None:
        check_mass_of(robot, method.mass)
    report = read_segments(robot, log)
    if bare is not None:
        method, finding = _with_mass(robot, method, report, bare)
        report = replace(report, findings=(*report.findings, finding))
    estimated = estimate_segments(robot, report, method, _MOST_WALKS)
    found = measure_payload(robot, method.prior_run, estimated.result)
    if found.answer in ("added", "removed") and (wide := _undetermined(robot, found)):
        remedy = "" if method.mass is not None else "; pass --mass KG, or --bare-log LOG after a prior run"
        found = replace(found, message=f"{found.message}; cannot tell {', '.join(wide)}{remedy}")
    return found, estimated.report


@contextmanager
def naming_bare_log() -> Generator[None]:
    """Name the bare log in errors."""
    try:
        yield
    except RecordingError as error:
        raise RecordingError(f"the bare log: {error}", error.report, details=error.details) from error


def _with_mass(
    robot: RobotModel, method: BayesianMethod, report: LogReport, bare: Log
) -> tuple[BayesianMethod, LogFinding]:
    """Return the method with the robot's mass by the loads on its feet over those in the bare log, and the finding."""
    assert method.prior_run is not None  # as the caller has checked
    with naming_bare_log():
        unloaded = read_segments(robot, bare)
    mass, std = mass_by_ratio(robot, method.prior_run, report.segments, unloaded.segments)
    finding = LogFinding(
        "bare log", f"the robot has {mass:.3f} kg (std {std:.3f}) by the loads on its feet in both walks"
    )
    return replace(method, mass=mass, mass_std=std, relative_mass=True), finding


def _undetermined(robot: RobotModel, found: PayloadMeasurement) -> list[str]:
    """Return the mass and CoM coordinates of the payload whose interval is missing or too wide, with the limit."""
    payload, place = found.change.payload, _PLACE_WITHIN * nominal_stance(robot).scale.length
    limits = [
        (_MASS_WITHIN * (payload.mass.value or 0.0), f"{100 * _MASS_WITHIN:.0f} %"),
        *3 * [(place, f"{1000 * place:.0f} mm")],
    ]
    return [
        f"{called(one.name)} within {words}"
        for one, (limit, words) in zip((payload.mass, *payload.com_in_base), limits, strict=True)
        if one.half_width is None or one.half_width > limit
    ]
