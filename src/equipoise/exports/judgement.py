"""What speaks against a result, and what of it is not written unless that is overridden."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from equipoise.errors import NotEstimatedError, NotIdentifiedError
from equipoise.exports.found import LEGS, MOTORS, SENSORS, Column, columns_of
from equipoise.result.calibration import Calibration
from equipoise.result.quantity import Quantity

_HOW = {
    SENSORS: "calibrate with --method precise",
    MOTORS: "calibrate with --what base,motors",
    LEGS: "calibrate with --what base,legs",
}


def judge(result: Calibration, bodies: Sequence[str], force: bool) -> tuple[str, ...]:
    """What speaks against a result's bodies, a sentence each, worst first.

    Raises:
        NotEstimatedError: its method does not estimate one of them.
        NotIdentifiedError: a parameter is not identified, and that is not overridden.
    """
    for body in bodies:
        try:
            getattr(result, body).parameters()
        except NotEstimatedError as error:
            raise NotEstimatedError(f"{body}: {error}; calibrate with --method precise") from None
    missing = _with_verdict(result, bodies, "not identified")
    if missing and not force:
        raise NotIdentifiedError(
            f"not identified by this run: {', '.join(missing)}; calibrate longer (--budget) or with a scale (--mass), or "
            "write them all the same with --force"
        )
    notes = [f"FORCED: not identified, hardly more than the model file's word: {', '.join(missing)}"] if missing else []
    if _with_verdict(result, bodies, "doubtful"):
        _refuse_doubtful(result, force)
    notes += _failed(result)
    weak = _with_verdict(result, bodies, "weak")
    notes += [f"assumed: {assumption}" for assumption in result.assumptions]
    return (*notes, *([f"weakly identified: {', '.join(weak)}"] if weak else []))


def judge_columns(result: Calibration, parts: Sequence[str], force: bool) -> tuple[tuple[Column, ...], tuple[str, ...]]:
    """What is written of sensors and motors, and what speaks against it, a sentence each, worst first.

    Of a table with a row for every joint, what is not identified is left out, or, by force, written. A part of which nothing
    remains is refused.

    Args:
        parts: those of "sensors", "motors" and "legs" that are wanted.

    Raises:
        NotEstimatedError: the run did not look at a part.
        NotIdentifiedError: it told nothing of a part, or a check of it failed, and that is not overridden.
    """
    found = [column for part in parts for column in _columns(result, part, force)]
    if not found:
        return (), ()
    _refuse_doubtful(result, force)
    missing, weak = _names(found, _missing), _names(found, lambda quantity: quantity.verdict == "weak")
    how = "FORCED: not identified" if force else "not identified, so left out (in lists: 0)"
    notes = [f"{how}: {missing}"] if missing else []
    notes += _failed(result)
    notes += [f"weakly identified: {weak}"] if weak else []
    written = found if force else [column.only(_told) for column in found]
    return tuple(column for column in written if column.values), tuple(notes)


def _columns(result: Calibration, part: str, force: bool) -> tuple[Column, ...]:
    columns = columns_of(result, part)
    if not columns:
        raise NotEstimatedError(f"this run did not look at {part}; {_HOW[part]}")
    if not force and not any(column.only(_told).values for column in columns):
        raise NotIdentifiedError(
            f"not identified by this run: {_names(columns, _missing)}; calibrate longer (--budget), or write them "
            "all the same with --force"
        )
    return columns


def _failed(result: Calibration) -> list[str]:
    return [f"check failed: {check.name}: {check.message}" for check in result.checks if not check.passed]


def _refuse_doubtful(result: Calibration, force: bool) -> None:
    if (failed := _failed(result)) and not force:
        raise NotIdentifiedError(
            f"the result is doubtful: {'; '.join(failed)}; mend that and calibrate again, or write it with --force"
        )


def _with_verdict(result: Calibration, bodies: Iterable[str], verdict: str) -> list[str]:
    return [
        f"{body} {quantity.name}"
        for body in bodies
        for quantity in getattr(result, body)
        if quantity.verdict == verdict
    ]


def _missing(quantity: Quantity) -> bool:
    return quantity.verdict == "not identified"


def _told(quantity: Quantity) -> bool:
    return not _missing(quantity)


def _names(columns: Iterable[Column], wanted: Callable[[Quantity], bool]) -> str:
    """Which values, column by column."""
    chosen = ((column, column.only(wanted).values) for column in columns)
    return ", ".join(
        f"{column.name} ({'all' if len(some) == len(column.values) else ' '.join(some)})"
        for column, some in chosen
        if some
    )
