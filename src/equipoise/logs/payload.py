"""Payload from the log of a robot that walks, against a prior run or the model file."""

from __future__ import annotations

from dataclasses import replace

from equipoise.bayesian.method import BayesianMethod
from equipoise.calibration.payload_measurement import PayloadMeasurement, measure_payload
from equipoise.logs.offline import LogReport, estimate_log
from equipoise.logs.raw_log import Log
from equipoise.result.shown import called
from equipoise.robot.model import RobotModel
from equipoise.robot.stance import nominal_stance

_MOST_WALKS = 12  # of 2 s: model errors exceed the noise after 20 s
# Largest half widths of an answer: of the payload's mass, and of its place on an A1 [m].
_MASS_WITHIN, _PLACE_WITHIN = 0.1, 10e-3


def measure_payload_in_log(robot: RobotModel, log: Log, method: BayesianMethod) -> tuple[PayloadMeasurement, LogReport]:
    """Measure the payload in a log against the prior run of the method, or, without one, against the model file.

    The message names what the log does not determine: the mass within 10 % of the payload's, and its place within 10 mm on an
    A1 (half widths of 95 % intervals).

    Raises:
        RecordingError: nothing in the log can be used, or its sensors are not plausible.
        SettingsError: the prior run is of another robot.
    """
    estimated = estimate_log(robot, log, method, _MOST_WALKS)
    found = measure_payload(robot, method.prior_run, estimated.result)
    if found.answer in ("added", "removed") and (wide := _undetermined(robot, found)):
        remedy = "" if method.mass is not None else "; pass --mass KG"
        found = replace(found, message=f"{found.message}; cannot tell {', '.join(wide)}{remedy}")
    return found, estimated.report


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
