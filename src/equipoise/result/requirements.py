"""Requirements that a script may have of a result, as words on a command line."""

from __future__ import annotations

from collections.abc import Iterable

from equipoise.errors import SettingsError, did_you_mean
from equipoise.result.body import Body
from equipoise.result.findings import Check
from equipoise.result.quantity import Quantity
from equipoise.robot.inertial import COMPONENTS

UNMET = 11
"""Exit code of a command whose result is there and does not meet what was required of it."""
WORDS = ("identified", "checks", *COMPONENTS)
"""All quantities that the method estimates are identified; all checks passed; or one quantity is identified."""


def read_requirements(text: str | None) -> tuple[str, ...]:
    """Words from "identified,checks"; raises SettingsError for others."""
    words = tuple(word.strip() for word in (text or "").split(",") if word.strip())
    for word in words:
        if word not in WORDS:
            raise SettingsError(
                f"--fail-unless {text}: {word!r} cannot be required; {did_you_mean(word, WORDS)}those are {', '.join(WORDS)}"
            )
    if text is not None and not words:
        raise SettingsError(f"--fail-unless names nothing; give it as identified,checks or one of {', '.join(WORDS)}")
    return words


def verdicts(body: Body, checks: Iterable[Check]) -> dict[str, bool]:
    """Which of WORDS are met.

    Args:
        body: body that was found.
        checks: checks of the run that it comes from.
    """
    told = [quantity for quantity in body if quantity.value is not None]
    own = {quantity.name: _identified(quantity) for quantity in body}
    checked = [check.passed for check in checks]
    return {"identified": bool(told) and all(map(_identified, told)), "checks": bool(checked) and all(checked), **own}


def _identified(quantity: Quantity) -> bool:
    return quantity.verdict == "identified"
