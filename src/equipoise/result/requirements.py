"""Requirements on a result from the command line (`--fail-unless`)."""

from __future__ import annotations

from collections.abc import Iterable

from equipoise.errors import SettingsError, did_you_mean
from equipoise.result.body import Body
from equipoise.result.findings import Check
from equipoise.result.quantity import Quantity
from equipoise.robot.inertial import COMPONENTS

UNMET = 11
"""Exit code of a command whose result does not meet its requirements."""
WORDS = ("identified", "checks", *COMPONENTS)
"""All quantities that the method estimates are identified; all checks passed; or one quantity is identified."""


def read_requirements(text: str | None) -> tuple[str, ...]:
    """Return the requirements of a text such as "identified,checks"; raises SettingsError for unknown ones."""
    words = tuple(word.strip() for word in (text or "").split(",") if word.strip())
    for word in words:
        if word not in WORDS:
            raise SettingsError(
                f"--fail-unless {text}: {word!r} is not a requirement; {did_you_mean(word, WORDS)}use {', '.join(WORDS)}"
            )
    if text is not None and not words:
        raise SettingsError(f"--fail-unless is empty; use identified,checks or any of {', '.join(WORDS)}")
    return words


def verdicts(body: Body, checks: Iterable[Check]) -> dict[str, bool]:
    """Return True for each of WORDS that is met.

    Args:
        body: estimated body.
        checks: checks of its run.
    """
    estimated = [quantity for quantity in body if quantity.value is not None]
    own = {quantity.name: _identified(quantity) for quantity in body}
    checked = [check.passed for check in checks]
    identified = bool(estimated) and all(map(_identified, estimated))
    return {"identified": identified, "checks": bool(checked) and all(checked), **own}


def _identified(quantity: Quantity) -> bool:
    return quantity.verdict == "identified"
