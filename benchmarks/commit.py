"""The commit that a results page was made at: a page without it is of no known code."""

import subprocess
from pathlib import Path


def commit() -> str:
    """Short name of the checkout's commit; with a plus if the source has changed since."""
    root = Path(__file__).resolve().parents[1]

    def git(*arguments: str) -> str:
        return subprocess.run(["git", "-C", str(root), *arguments], capture_output=True, text=True, check=True).stdout

    return git("rev-parse", "--short", "HEAD").strip() + ("+" if git("status", "--porcelain", "src").strip() else "")
