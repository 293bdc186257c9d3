"""HTML of report blocks, with all text escaped."""

from __future__ import annotations

import html
import re
from collections.abc import Iterable, Sequence
from itertools import groupby

from equipoise.figures.blocks import BAR, LONG, Block, Cell, DataTable, Figure, PageContents, anchor
from equipoise.result.quantity import Quantity

_SECONDARY = ("truth", "error", "model", "change")  # shown below the estimate on narrow screens
# Verdicts are distinguished by a sign and a word too, for readers who do not see the colours.
_VERDICTS = {
    "identified": ("\u25cf", "good"), "weak": ("\u25d0", "warn"), "not identified": ("\u25cb", "poor"),
    "doubtful": ("\u25cb", "poor"), "passed": ("\u2713", "good"), "failed": ("\u2717", "poor"),
}  # fmt: skip
_MINUS = re.compile(r"(?<![\w./\-])-(?=\d)")
_WIDTH, _MARGIN = 118, 0.08  # width of a bar [px], and the empty fraction at each end


def typeset(text: str) -> str:
    """Return escaped text with true minus and plus-minus signs."""
    return html.escape(_MINUS.sub("\u2212", text.replace("+-", "\u00b1")))


def blocks_html(blocks: Iterable[Block]) -> str:
    """Return the HTML of blocks in order, with neighbouring figures in a grid."""
    parts: list[str] = []
    for kind, group in groupby(blocks, key=type):
        made = [block_html(block) for block in group]
        parts += [f'<div class="figures">{"".join(made)}</div>'] if kind is Figure else made
    return "\n".join(parts)


def block_html(block: Block) -> str:
    """Return the HTML of one block."""
    if isinstance(block, DataTable):
        return _table(block)
    if isinstance(block, Figure):
        return _figure(block)
    if isinstance(block, str):
        return f"<p>{_prose(block)}</p>"
    return f"<ul>{''.join(f'<li>{_prose(item)}</li>' for item in block)}</ul>"


def _prose(text: str) -> str:
    """Return typeset text, with text between backticks as code."""
    return re.sub("`([^`]+)`", r"<code>\1</code>", typeset(text))


def _figure(figure: Figure) -> str:
    words = typeset(f"{figure.title}. {figure.caption}")
    plot = f'<div class="plot" role="img" aria-label="{words}" style="min-height: {figure.height}px"></div>'
    heading = f"<h3>{typeset(figure.title)}</h3>"
    return f"<figure>{heading}{plot}<figcaption>{typeset(figure.caption)}</figcaption></figure>"


def _table(table: DataTable) -> str:
    top = "".join(map(_heading, table.columns))
    rows = "".join(f"<tr>{_row(row, table.columns)}</tr>" for row in table.rows)
    title = typeset(table.title)
    made = (
        f'<table class="{table.style}" aria-label="{title}"><thead><tr>{top}</tr></thead><tbody>{rows}</tbody></table>'
    )
    made = f'<div class="scroll">{made}</div>'
    if table.folded:
        return f"<details><summary>{title}</summary>{made}</details>"
    return f'<div class="table"><p class="caption">{title}</p>{made}{_key(table)}</div>'


def _heading(column: str) -> str:
    number = column.startswith("|")
    return f'<th scope="col"{_class(number=number)}>{typeset(column.removeprefix("|"))}</th>'


def _row(row: Sequence[str | Cell], columns: Sequence[str]) -> str:
    cells: list[str] = []
    made = [cell if isinstance(cell, Cell) else Cell(cell) for cell in row]
    for index, (cell, column) in enumerate(zip(made, columns, strict=True)):
        head = column.removeprefix("|")
        tag = "td" if index else 'th scope="row"'
        kinds = {
            "number": column.startswith("|"),
            "long": len(cell.text) > LONG,
            "secondary": head in _SECONDARY,
            cell.tone: bool(cell.tone),
        }
        inside = _bar(cell.bar) if cell.bar else " ".join(filter(None, (typeset(cell.text), _verdict(cell.verdict))))
        cells.append(f'<{tag} data-head="{typeset(head)}"{_class(**kinds)}>{inside}</{tag[:2]}>')
    return "".join(cells)


def _class(**kinds: bool) -> str:
    there = " ".join(name for name, given in kinds.items() if given)
    return f' class="{there}"' if there else ""


def _verdict(word: str) -> str:
    sign, tone = _VERDICTS.get(word, ("", ""))
    return f'<span class="verdict {tone}">{sign} {html.escape(word)}</span>' if word else ""


def bar_places(found: Quantity) -> dict[str, float]:
    """Return the positions of interval, model value, truth and estimate along a bar, from 0 to 1."""
    values = {name: getattr(found, name) for name in ("lower", "upper", "model", "truth", "value")}
    known = {name: float(value) for name, value in values.items() if value is not None}
    low, span = min(known.values()), (max(known.values()) - min(known.values())) or 1.0
    return {name: _MARGIN + (1 - 2 * _MARGIN) * (value - low) / span for name, value in known.items()}


def _bar(found: Quantity) -> str:
    places = {name: _WIDTH * place for name, place in bar_places(found).items()}
    parts = [f'<path class="axis" d="M0 10H{_WIDTH}"/>']
    if "lower" in places:
        parts.append(_band(places["lower"], max(3.0, places["upper"] - places["lower"])))
    parts += [_mark(kind, places[kind], 10) for kind in ("model", "truth", "value") if kind in places]
    return f'<svg viewBox="0 0 {_WIDTH} 20" role="img" aria-hidden="true">{"".join(parts)}</svg>'


def _band(x: float, width: float) -> str:
    return f'<rect class="band" x="{x:.1f}" y="6" width="{width:.1f}" height="8" rx="2"/>'


def _mark(kind: str, x: float, y: float) -> str:
    """Return the marker of an estimate (dot), a model value (square) or the truth (cross)."""
    if kind == "value":
        return f'<circle class="found" cx="{x:.1f}" cy="{y}" r="3"/>'
    if kind == "model":
        return f'<rect class="model" x="{x - 4:.1f}" y="{y - 4}" width="8" height="8"/>'
    return f'<path class="truth" d="M{x - 3.5:.1f} {y - 3.5}l7 7m-7 0l7 -7"/>'


def _key(table: DataTable) -> str:
    """Return the legend of bars and bold changes; empty for a table without bars."""
    bars = [cell.bar for row in table.rows for cell in row if isinstance(cell, Cell) and cell.bar]
    if BAR not in table.columns or not bars:
        return ""
    intervals = any(bar.half_width is not None for bar in bars)
    samples = {
        "95 % interval": _band(0, 16) if intervals else "",
        "estimate": _mark("value", 8, 10),
        "model file": _mark("model", 8, 10) if any(bar.model is not None for bar in bars) else "",
        "truth (simulation)": _mark("truth", 8, 10) if any(bar.truth is not None for bar in bars) else "",
    }
    words = [
        f'<span><svg viewBox="0 4 16 12" aria-hidden="true">{sample}</svg>{name}</span>'
        for name, sample in samples.items()
        if sample
    ]
    words += ["<span>bold change: the model file's value is outside the interval</span>"] if intervals else []
    return f'<p class="key">{"".join(words)}</p>'


def document_html(document: PageContents) -> tuple[str, str]:
    """Return the navigation links and the body of a page."""
    links = "".join(f'<a href="#{anchor(title)}">{typeset(title)}</a>' for title in document.sections)
    alerts = "".join(
        f'<p class="alert"><span title="{typeset(message)}"><b>{typeset(name)}</b> {typeset(message)}</span></p>'
        for name, message in document.alerts
    )
    figures = [block for block in document.first if isinstance(block, Figure)]
    others = [block for block in document.first if not isinstance(block, Figure)]
    drawing = f'<div id="plan-view">{blocks_html(figures)}</div>' if figures else ""
    head = f'<h1>{typeset(document.title)}</h1><p id="subtitle">{typeset(document.subtitle)}</p>'
    head += f'<div id="actions">{blocks_html(document.actions)}</div>' if document.actions else ""
    head += f'<p id="lead">{_prose(document.lead)}</p>' if document.lead else ""
    numbers = f'<div id="numbers">{blocks_html(others)}</div>' if others else ""
    first = f'<div id="first">{numbers}{drawing}</div>'
    below = "".join(_section(title, blocks) for title, blocks in document.sections.items())
    return links, f'{head}<div id="alerts">{alerts}</div>{first}{below}'


def _section(title: str, blocks: Iterable[Block]) -> str:
    name = anchor(title)
    heading = f'<h2 id="{name}-title">{typeset(title)}</h2>'
    return f'<section id="{name}" aria-labelledby="{name}-title">{heading}{blocks_html(blocks)}</section>'


def figures_of(document: PageContents) -> list[Figure]:
    """Return the figures in page order."""
    blocks = [*document.first, *(block for section in document.sections.values() for block in section)]
    return [block for block in blocks if isinstance(block, Figure)]
