"""Errors for callers and scripts."""

import pytest

from equipoise import errors
from equipoise.errors import EquipoiseError

EXIT_CODES = {
    "EquipoiseError": 1,
    "SettingsError": 2,
    "ModelError": 3,
    "MotionError": 4,
    "ReachError": 4,
    "FallError": 4,
    "CommunicationError": 10,
    "StoppedError": 4,
    "RecordingError": 5,
    "OutputError": 6,
    "MissingDependencyError": 7,
    "NotEstimatedError": 8,
}
STANDARD = {
    "SettingsError": ValueError,
    "ModelError": ValueError,
    "MotionError": RuntimeError,
    "ReachError": RuntimeError,
    "FallError": RuntimeError,
    "CommunicationError": ConnectionError,
    "RecordingError": ValueError,
    "OutputError": OSError,
    "MissingDependencyError": ImportError,
    "NotEstimatedError": ValueError,
}


def test_every_error_has_its_stable_exit_code():
    classes = [c for c in vars(errors).values() if isinstance(c, type) and issubclass(c, EquipoiseError)]
    assert {c.__name__: c.exit_code for c in classes} == EXIT_CODES


@pytest.mark.parametrize("name", STANDARD)
def test_an_error_is_the_standard_one_that_a_caller_would_catch(name):
    error = getattr(errors, name)("what is wrong and what to do")
    assert isinstance(error, STANDARD[name])
    assert str(error) == "what is wrong and what to do"


def test_an_error_of_a_log_carries_the_report():
    error = errors.RecordingError("nothing in it", "the report", details={"log": {"segments": []}})
    assert (error.report, error.details["log"]) == ("the report", {"segments": []})
    assert dict(errors.RecordingError("damaged").details) == {}


def test_a_motion_error_carries_the_recordings():
    assert errors.FallError("it fell").recordings == ()
    assert errors.FallError("it fell", ("first", "second")).recordings == ("first", "second")
