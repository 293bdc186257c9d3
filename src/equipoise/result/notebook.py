"""HTML table of a result for notebooks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from equipoise.result.quantity import Quantity
from equipoise.result.shown import ROWS


def notebook_table(robot: str, method: str, quantities: Iterable[Quantity], warnings: Sequence[str]) -> str:
    """Return the HTML table of a body's estimated quantities, below the warnings."""
    estimated = [(row, one) for row, one in zip(ROWS, quantities, strict=True) if one.value is not None]
    columns = [
        "",
        "estimate",
        "95 %",
        "",
        "model",
        *(["truth"] if any(one.truth is not None for _, one in estimated) else []),
    ]
    head = "".join(f"<th>{column}</th>" for column in columns)
    rows = "".join(f"<tr>{''.join(_cells(*row[1:], one, len(columns)))}</tr>" for row, one in estimated)
    messages = "".join(f"<p><b>{escape(warning)}</b></p>" for warning in warnings)
    caption = f"<caption>{escape(robot)}: the whole robot at its stance, method {escape(method)}</caption>"
    return f"{messages}<table>{caption}<thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"


def _cells(label: str, factor: float, form: str, one: Quantity, count: int) -> list[str]:
    def shown(value: float | None, before: str = "") -> str:
        return "" if value is None else f"{before}{value * factor:{form}}"

    values = [shown(one.value), shown(one.half_width, "\u00b1 "), one.verdict or "", shown(one.model), shown(one.truth)]
    return [f"<td>{escape(text)}</td>" for text in [label, *values][:count]]
