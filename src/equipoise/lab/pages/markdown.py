"""Markdown form of pages."""

from __future__ import annotations

from collections.abc import Iterator

from equipoise.figures.blocks import Block, DataTable, Figure, PageContents, anchor


def markdown(document: PageContents, page: str) -> str:
    """Return the text of a document, with links to the figures of its page."""
    lines = [f"# {document.title}", "", document.lead, ""]
    for block in document.first:
        lines += [*_lines(block, page), ""]
    for title, blocks in document.sections.items():
        lines += [f"## {title}", ""]
        for block in blocks:
            lines += [*_lines(block, f"{page}#{anchor(title)}"), ""]
    return "\n".join(lines[:-1]) + "\n"


def _lines(block: Block, page: str) -> Iterator[str]:
    if isinstance(block, DataTable):
        yield _row(head.removeprefix("|") for head in block.columns)
        yield "|---" * len(block.columns) + "|"
        yield from (_row(map(str, row)) for row in block.rows)
    elif isinstance(block, Figure):
        yield f"[Figure: {block.title}]({page})"
    elif isinstance(block, str):
        yield block
    else:
        yield from (f"- {item}" for item in block)


def _row(cells: Iterator[str]) -> str:
    return f"| {' | '.join(cells)} |"
