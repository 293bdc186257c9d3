"""The commit that a results page was made at: a page without it is of no known code."""

import subprocess
from collections.abc import Iterable, Mapping
from pathlib import Path

import equipoise


def commit() -> str:
    """Short name of the commit of the code that runs; with a plus if it has changed since."""
    root = Path(equipoise.__file__).resolve().parents[2]

    def git(*arguments: str) -> str:
        return subprocess.run(["git", "-C", str(root), *arguments], capture_output=True, text=True, check=True).stdout

    return git("rev-parse", "--short", "HEAD").strip() + ("+" if git("status", "--porcelain", "src").strip() else "")


def made_at(rows: Iterable[Mapping[str, object]]) -> str:
    """The last line of a page that is made of rows which say their commits."""
    return f"Made at commit {', '.join(sorted({str(row['commit']) for row in rows}))}."


def checkout(path: str | Path) -> str:
    """Name and commit of somebody else's git checkout that a path is in."""

    def git(*arguments: str) -> str:
        command = ["git", "-C", str(path), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    return f"{Path(git('rev-parse', '--show-toplevel')).name} {git('rev-parse', '--short=10', 'HEAD')}"
