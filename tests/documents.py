"""Pages of the documents, their code blocks, and the commands in these."""

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
WEIGHED = ("--mass KG", "--mass 16.1")  # what a reader types for KG, here for a Go2
_FENCED = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
_INDENTED = re.compile(r"(?:^ {4}\S.*\n(?:^ {4}.*\n|^\n(?= {4}))*)", re.MULTILINE)
_NUMBER = re.compile(r"-?\d+\.\d+|-?\d+")


@dataclass(frozen=True)
class Block:
    """Code block on a page; `shown` is the following block if it is output."""

    page: str
    language: str
    code: str
    shown: str | None = None


def blocks(page):
    """Return the code blocks of a page, in order."""
    text = page.read_text(encoding="utf-8")
    found = [(match.start(), match.end(), match[1], match[2]) for match in _FENCED.finditer(text)]
    plain = _FENCED.sub(lambda match: re.sub(r"[^\n]", "x", match[0]), text)
    found += [
        (match.start(), match.end(), "", re.sub(r"^ {4}", "", match[0], flags=re.MULTILINE))
        for match in _INDENTED.finditer(plain)
    ]
    found.sort()
    name = page.relative_to(ROOT).as_posix()
    for (_, end, language, code), following in zip(found, [*found[1:], None], strict=False):
        follows = following is not None and not following[2] and not text[end : following[0]].strip()
        yield Block(name, language, code, following[3] if follows else None)


def commands(program):
    """Return (page, arguments, shown output) of each distinct command of a program on all pages."""
    seen = {}
    for page in PAGES:
        for block in blocks(page):
            if block.language not in ("", "console", "bash", "sh"):
                continue
            for line in block.code.replace("\\\n", " ").replace(*WEIGHED).splitlines():
                if line.startswith(f"{program} "):
                    arguments = tuple(shlex.split(line, comments=True)[1:])
                    if "..." not in arguments:
                        seen.setdefault(arguments, (block.page, arguments, block.shown))
    return list(seen.values())


def assert_shown(printed, shown, **tolerance):
    """Assert that printed text equals shown text, within a tolerance for numbers; '...' matches any lines."""
    lines = printed.rstrip().splitlines()
    for line in shown.rstrip().splitlines():
        if line.strip() == "...":
            while lines and not _like(lines[0], shown.rstrip().splitlines()[-1]):
                lines.pop(0)
            continue
        assert lines, f"not printed: {line}"
        ours = lines.pop(0)
        assert _like(ours, line), f"{ours!r} is shown as {line!r}"
        for mine, theirs in zip(_NUMBER.findall(ours), _NUMBER.findall(line), strict=True):
            off = abs(float(mine) - float(theirs))
            assert off <= tolerance["abs"] + tolerance["rel"] * abs(float(theirs)), f"{ours!r} is shown as {line!r}"
    assert not lines


def _like(ours, theirs):
    """Return true if two lines are equal except for numbers, blanks and verdicts, which may differ near a limit."""
    plain = [re.sub(r"[+-]?\d+(\.\d+)?|(not )?identified|weak|\s+", "#", line).strip() for line in (ours, theirs)]
    return re.sub("#+", "#", plain[0]) == re.sub("#+", "#", plain[1])
