"""A result as a notebook shows it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from equipoise.result.quantity import Quantity

_MILLI = {"m": ("mm", 1000.0)}  # units that people see
_FORMS = {"kg": ".3f", "m": ".2f"}


def notebook_table(robot: str, method: str, quantities: Iterable[Quantity], warnings: Sequence[str]) -> str:
    """HTML table of the quantities that have a value, warnings above it."""
    known = [one for one in quantities if one.value is not None]
    columns = ["", "estimate", "95 %", "", "model", *(["truth"] if any(one.truth is not None for one in known) else [])]
    head = "".join(f"<th>{column}</th>" for column in columns)
    rows = "".join(f"<tr>{''.join(_cells(one, len(columns)))}</tr>" for one in known)
    said = "".join(f"<p><b>{escape(warning)}</b></p>" for warning in warnings)
    caption = f"<caption>{escape(robot)}: the whole robot at its stance, method {escape(method)}</caption>"
    return f"{said}<table>{caption}<thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"


def _cells(one: Quantity, count: int) -> list[str]:
    unit, factor = _MILLI.get(one.unit, (one.unit, 1.0))
    form = _FORMS.get(one.unit, ".4f")

    def shown(value: float | None, before: str = "") -> str:
        return "" if value is None else f"{before}{value * factor:{form}}"

    name = one.name.replace("com_", "CoM ")
    texts = [
        f"{name} [{unit}]",
        shown(one.value),
        shown(one.half, "\u00b1 "),
        one.verdict or "",
        shown(one.model),
        shown(one.truth),
    ]
    return [f"<td>{escape(text)}</td>" for text in texts[:count]]
