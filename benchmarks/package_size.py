"""Size of the package in lines and public classes, as a whole and of the modules imported by a calibration.

    python benchmarks/package_size.py                     # the package that is installed or on PYTHONPATH
    PYTHONPATH=/tmp/before/src python benchmarks/package_size.py   # another commit, from a git worktree

Prints a Markdown table. Code lines exclude blank lines, comments and docstrings. Imported modules are those in `sys.modules`
after `from equipoise import calibrate`, and at the end of a simulated `equipoise calibrate unitree_a1 --method bayesian`.
"""

from __future__ import annotations

import ast
import importlib.util
import json
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

COMMAND = ["calibrate", "unitree_a1", "--method", "bayesian", "--quiet", "--no-report"]
_IMPORTED = """
import atexit, json, sys
atexit.register(lambda: print(json.dumps([
    module.__file__ for name, module in sys.modules.items()
    if name.partition(".")[0] == "equipoise" and getattr(module, "__file__", None)
])))
"""


class Module(NamedTuple):
    """Size of one file."""

    path: Path
    lines: int
    """Number of lines."""
    code: int
    """Number of lines without blank lines, comments and docstrings."""
    classes: int
    """Number of public classes at the top level."""
    functions: dict[str, int]
    """Lines of each function and method, including signature and docstring."""


def measure(path: Path) -> Module:
    """Return the sizes of a file."""
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text)
    words: set[int] = set()
    functions: dict[str, int] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            functions[node.name] = (node.end_lineno or node.lineno) - node.lineno + 1
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            words |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    lines = text.splitlines()
    code = sum(
        1
        for number, line in enumerate(lines, 1)
        if line.strip() and not line.lstrip().startswith("#") and number not in words
    )
    classes = sum(isinstance(node, ast.ClassDef) and not node.name.startswith("_") for node in tree.body)
    return Module(path, len(lines), code, classes, functions)


def imported_after(statements: str) -> list[Path]:
    """Return the files of the package that a program has imported at its end."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, "-c", _IMPORTED + statements], capture_output=True, text=True, check=False, cwd=folder
        )
    if done.returncode:
        raise SystemExit(f"the calibration failed:\n{done.stderr}")
    return [Path(file) for file in json.loads(done.stdout.splitlines()[-1])]


def row(what: str, modules: Iterable[Module]) -> str:
    """Return a line of the table."""
    modules = list(modules)
    lines, code, classes = (sum(sizes) for sizes in zip(*[(m.lines, m.code, m.classes) for m in modules], strict=True))
    return f"| {what} | {len(modules)} | {lines} | {code} | {classes} |"


def main() -> None:
    """Print the tables."""
    home = Path(importlib.util.find_spec("equipoise").origin).parent  # type: ignore[union-attr]
    modules = {path: measure(path) for path in sorted(home.rglob("*.py"))}
    run = (
        f"import sys, runpy\nsys.argv = ['equipoise', *{COMMAND!r}]\nrunpy.run_module('equipoise', run_name='__main__')"
    )
    print("| what | modules | lines | code | public classes |\n|---|---|---|---|---|")
    for what, program in (("from equipoise import calibrate",) * 2, (f"equipoise {' '.join(COMMAND[:4])}", run)):
        print(row(f"imported by `{what}`", map(measure, imported_after(program))))
    print(row("the package", modules.values()))
    rooms = Counter(path.relative_to(home).parts[0] for path in modules)
    for room in sorted(name for name in rooms if (home / name).is_dir()):
        print(row(f"`{room}/`", (m for path, m in modules.items() if path.relative_to(home).parts[0] == room)))
    print("\n| longest modules | lines |\n|---|---|")
    for module in sorted(modules.values(), key=lambda module: -module.lines)[:8]:
        print(f"| `{module.path.relative_to(home)}` | {module.lines} |")
    print("\n| longest functions | lines |\n|---|---|")
    functions = ((size, name, m.path) for m in modules.values() for name, size in m.functions.items())
    for size, name, path in sorted(functions, reverse=True)[:8]:
        print(f"| `{name}` in `{path.relative_to(home)}` | {size} |")


if __name__ == "__main__":
    main()
