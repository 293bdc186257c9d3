"""What a writer hands back."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Written:
    """A file's content, and words for the body or the parts that it holds."""

    content: bytes
    about: str
    notes: tuple[str, ...] = ()  # what speaks against it, found while writing

    @classmethod
    def text(cls, lines: list[str], about: str) -> Written:
        """From lines of text."""
        return cls(("\n".join(lines) + "\n").encode(), about)
