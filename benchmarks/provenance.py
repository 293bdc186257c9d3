"""Provenance of a results page: commit and sources of its script, and detection of later changes.

The last line of a page is "Made at commit COMMIT; sources HASH.", written by `write_page("NAME.md", text)`. The hash covers
the script of the page and its imports from the project (`sources.py`). A page is current if its hash equals that of the
present sources. After a change that should not affect it, `check.py --confirm` repeats random rows; if they are equal, a line
with the present hash follows.

    python benchmarks/provenance.py              # every page: current, or the number of changed sources
    python benchmarks/provenance.py NAME.md      # add the last line to a page that a verb has just written
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path, PurePosixPath
from typing import NamedTuple

from sources import FOLDERS, ROOT, UNKNOWN, changes, hash_of

RESULTS = ROOT / "benchmarks" / "results"
MAKERS = {"paper/README.md": "benchmarks/paper.py"}
"""Maker of each page whose script has another name."""
_REPEATED = re.compile(r"\n*^Repeated at commit (\S+): (\d+) rows, equal; sources (\S+)\.$", re.MULTILINE)
_LAST_LINE = re.compile(r"^Made at commit ([^;\n]+); sources ([^;\n]+)\.$", re.MULTILINE)


def write_page(name: str, text: str, rows: Iterable[Mapping[str, object]] | None = None) -> None:
    """Write a page and its last line, "Made at commit COMMIT; sources HASH.".

    Args:
        name: path of the page in `benchmarks/results`.
        text: text of the page without its last line.
        rows: rows of the page, each with its "commit"; without rows, the present commit is used.
    """
    commits = [commit()] if rows is None else sorted({str(row.get("commit", UNKNOWN)) for row in rows})
    hashes = dict.fromkeys(hash_of(maker_of(name), "" if one == commit() else one) for one in commits)
    made = f"Made at commit {', '.join(commits)}; sources {', '.join(hashes)}."
    text = _LAST_LINE.sub("", _REPEATED.sub("", text)).rstrip()
    (RESULTS / name).write_text(f"{text}\n\n{made}\n", encoding="utf-8")


def confirm_page(name: str, rows: int) -> None:
    """Add a line to a page: some rows, repeated with the present sources, are equal."""
    text = _REPEATED.sub("", (RESULTS / name).read_text(encoding="utf-8")).rstrip()
    line = f"Repeated at commit {commit()}: {rows} rows, equal; sources {hash_of(maker_of(name))}."
    (RESULTS / name).write_text(f"{text}\n\n{line}\n", encoding="utf-8")


def maker_of(name: str) -> str:
    """Return the path of the module that makes a page, from the repository's root."""
    return MAKERS.get(name, f"benchmarks/{PurePosixPath(name).stem}.py")


def commit() -> str:
    """Return the short name of the commit of the code that runs, with a plus if its sources have changed since."""
    changed = git("status", "--porcelain", "--", *FOLDERS, ":!benchmarks/results")
    return git("rev-parse", "--short", "HEAD").strip() + ("+" if changed.strip() else "")


def checkout(path: str | Path) -> str:
    """Return name and commit of the git checkout that a path is in."""
    name, at = (
        Path(git("rev-parse", "--show-toplevel", at=path).strip()).name,
        git("rev-parse", "--short=10", "HEAD", at=path),
    )
    return f"{name} {at.strip()}"


def git(*arguments: str, at: str | Path = ROOT) -> str:
    return subprocess.run(["git", "-C", str(at), *arguments], capture_output=True, text=True, check=True).stdout


class Page(NamedTuple):
    """Provenance of a results page."""

    maker: str
    """Path of the module that makes it, from the repository's root."""
    commits: tuple[str, ...]
    """Commits that its rows were made at; empty if the page does not name them."""
    hashes: tuple[str, ...]
    """Hashes of the sources at those commits."""
    confirmed: str = ""
    """Hash of the sources with which rows were repeated and equal."""

    @classmethod
    def read(cls, path: Path) -> Page:
        """Read the last line of a page in `benchmarks/results`; the page may also lie elsewhere under its path there."""
        maker = maker_of(path.relative_to(RESULTS).as_posix())
        text = path.read_text(encoding="utf-8")
        found, repeated = _LAST_LINE.findall(text), _REPEATED.findall(text)
        commits, hashes = (tuple(part.split(", ")) for part in found[-1]) if found else ((), ())
        return cls(maker, commits, hashes, repeated[-1][-1] if repeated else "")

    @property
    def is_current(self) -> bool:
        """True if the present sources made the whole page, or made repeated rows of it that were equal."""
        return hash_of(self.maker) == self.confirmed or self.hashes == (hash_of(self.maker),)

    @property
    def command(self) -> str:
        """Command that makes the page again."""
        return f"make bench-{PurePosixPath(self.maker).stem.replace('_', '-')}"

    @property
    def banner(self) -> str:
        """Note at the head of a page that is not current."""
        made = f"commit {', '.join(self.commits)}" if self.commits else "a commit that the page does not name"
        changed = [counts for name in self.commits if (counts := changes(self.maker, name)) is not None]
        how_many = ["{} of its {} source files have changed since".format(*max(changed))] if changed else []
        return "; ".join([f"Made by older code: {made}", *how_many, f"make it again with `{self.command}`."])


def pages() -> list[Path]:
    return sorted(RESULTS.rglob("*.md"))


def main() -> None:
    for name in sys.argv[1:]:
        write_page(name, (RESULTS / name).read_text(encoding="utf-8"))
    if sys.argv[1:]:
        return
    for path in pages():
        page = Page.read(path)
        print(f"{path.relative_to(RESULTS)}: {'current' if page.is_current else page.banner}")


if __name__ == "__main__":
    main()
