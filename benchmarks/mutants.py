"""Mutation test of safety limits: `make mutants`. The page `safety` has its results.

Each limit of the guard, its endings, the second connection and the doctor is loosened by half in a copy of the package, and
its tests are run on the copy. A mutant is detected if a test fails; a surviving mutant shows a limit without a test.
"""

from __future__ import annotations

import argparse
import ast
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from rows import Row, Table
from tables import markdown

ROOT = Path(__file__).parents[1]
LOOSER = 1.5
PATIENCE = 300.0  # [s] for the tests of one mutant; a timeout counts as detection

# By module: its tests, limits that are looser when larger, and when smaller.
LIMITS = {
    "guard/limits.py": (
        "guard/test_limits.py guard/test_joint_checks.py guard/test_command_checks.py guard/test_base_checks.py",
        "position_margin speed torque gains temperature lean lean_in_lift following excess_torque excess_force excess_weight "
        "missing_torque patience silence stall idle",
        "battery",
    ),
    "guard/command_checks.py": ("guard/test_limits.py guard/test_command_checks.py", "_ROUNDING _FIRST_JUMP", ""),
    "guard/joint_checks.py": (
        "guard/test_limits.py guard/test_joint_checks.py guard/test_stuck_detector.py",
        "_STUCK_TIME _STUCK_MOVE _RUNAWAY",
        "_STUCK_SHARE",
    ),
    "guard/base_checks.py": ("guard/test_base_checks.py", "_COMING_DOWN", ""),
    "guard/footing.py": ("guard/test_limits.py guard/test_footing.py", "_LIFTED _RAISED", "_SUNK _LEGS_UP"),
    "guard/sample_filter.py": (
        "guard/test_limits.py guard/test_sample_filter.py",
        "_FROZEN_TIME _FROZEN_MOVE _JUMP _JUMP_SPEED _FASTEST",
        "",
    ),
    "recording/encoder_steps.py": ("guard/test_limits.py", "_COARSEST _STILL_STEPS", ""),
    "guard/tilt_filter.py": ("guard/test_limits.py guard/test_tilt_filter.py", "_TIME _GRAVITY_TOLERANCE", ""),
    "guard/force_limit.py": ("guard/test_limits.py", "_GENTLE _RATE", ""),
    "guard/robot_loop.py": ("guard/test_limits.py", "", "_OBSERVE_TIME"),
    "guard/soft_start.py": ("guard/test_limits.py", "", "SOFT_START"),
    "guard/endings.py": (
        "guard/test_limits.py",
        "_LOWERING _SPEED_SHARE _FALLEN _FAR STILL _SILENT",
        "FEET_DOWN LIE_DOWN FADE _MOVED DAMPED_TIME STILL_TIME _LONGEST",
    ),
    "guard/second_connection.py": ("guard/test_limits.py", "_AGAIN", "_REACHED"),
    "drivers/checkup.py": (
        "drivers/test_checkup_limits.py drivers/test_checkup.py",
        "_PATIENCE _JITTER _LEAN _LYING_LEAN _BIAS _STILL _BEYOND _MASS_RANGE[1] _HOT",
        "_SLOWEST _USUAL _MASS_RANGE[0] _WEAK_BATTERY",
    ),
    "clearance/pairs.py": ("clearance/test_clearance.py", "", "_LEAST"),
}


@dataclass(frozen=True)
class Mutant:
    """Loosened limit.

    Attributes:
        module: path of the module in the package.
        limit: name of the limit, with an index into a tuple.
        factor: factor on the limit.
        tests: paths of its tests.
    """

    module: str
    limit: str
    factor: float
    tests: tuple[str, ...]

    @property
    def name(self) -> str:
        return f"{self.module} {self.limit}"

    def apply(self, source: str) -> str:
        """Return the module's text with the looser limit; raises LookupError if the limit is missing."""
        name, _, index = self.limit.rstrip("]").partition("[")
        for node in ast.walk(ast.parse(source)):
            value = _assigned(node, name)
            if isinstance(value, ast.Tuple) and index:
                value = value.elts[int(index)]
            if value is not None:
                return _replaced(source, value, f"({ast.unparse(value)}) * {self.factor!r}")
        raise LookupError(f"{self.module} has no limit {self.limit}")


def _assigned(node: ast.AST, name: str) -> ast.expr | None:
    """Return the value that a statement assigns to a name, alone or in a tuple."""
    if isinstance(node, ast.AnnAssign):
        return node.value if isinstance(node.target, ast.Name) and node.target.id == name else None
    if not isinstance(node, ast.Assign):
        return None
    target, value = node.targets[0], node.value
    if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
        named = zip(target.elts, value.elts, strict=True)
        return next((each for one, each in named if isinstance(one, ast.Name) and one.id == name), None)
    return value if isinstance(target, ast.Name) and target.id == name else None


def _replaced(source: str, node: ast.expr, text: str) -> str:
    lines = source.splitlines(keepends=True)
    line, start, end = node.lineno - 1, node.col_offset, node.end_col_offset
    lines[line] = lines[line][:start] + text + lines[line][end:]
    return "".join(lines)


def mutants() -> Iterator[Mutant]:
    """Yield all mutants."""
    for module, (tests, larger, smaller) in LIMITS.items():
        for names, factor in ((larger, LOOSER), (smaller, 1 / LOOSER)):
            for limit in names.split():
                yield Mutant(module, limit, factor, tuple(f"tests/{test}" for test in tests.split()))


@cache
def check_unchanged() -> None:
    """Run all tests on the unchanged package; raise SystemExit if one fails."""
    every = [f"tests/{test}" for tests, _, _ in LIMITS.values() for test in tests.split()]
    if failing := _failing(tuple(dict.fromkeys(every)), ROOT / "src"):
        raise SystemExit(f"{failing} fails on the unchanged package; fix it first")


def detected_by(name: str) -> str | None:
    """Return the test that detects a mutant; None if it survives."""
    check_unchanged()
    mutant = next(one for one in mutants() if one.name == name)
    with tempfile.TemporaryDirectory() as folder:
        source = Path(shutil.copytree(ROOT / "src", Path(folder, "src")))
        path = source / "equipoise" / mutant.module
        path.write_text(mutant.apply(path.read_text(encoding="utf-8")), encoding="utf-8")
        return _failing(mutant.tests, source)


def _failing(tests: tuple[str, ...], source: Path) -> str | None:
    environment = {**os.environ, "PYTHONPATH": str(source), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests]
    try:
        done = subprocess.run(
            command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False, timeout=PATIENCE
        )
    except subprocess.TimeoutExpired:
        return "timeout"
    if done.returncode == 0:
        return None
    failed = re.search(r"^(?:FAILED|ERROR) tests/([^\s\[]+)", done.stdout, re.MULTILINE)
    if failed is None:
        raise SystemExit(done.stdout + done.stderr)
    return failed[1].rpartition("::")[2]


def row_of(name: str) -> Row:
    """Return the row of a mutant."""
    return {"detected_by": detected_by(name)}


def show(rows: list[Row]) -> Iterator[str]:
    detected = sum(row["detected_by"] is not None for row in rows)
    share = f"{detected} of {len(rows)}"
    yield "## Loosened limits"
    yield ""
    yield (
        "`make mutants`. Each limit of the guard, its endings, the second connection and the doctor is loosened by a factor "
        f"of {LOOSER:g}, and its tests are run. A test detects {share if detected == len(rows) else f'**{share}**'} mutants."
    )
    yield ""
    yield from markdown(("module", "limits", "detected", "survivors"), _lines(rows))


def _lines(rows: list[Row]) -> Iterator[list[str]]:
    for module in LIMITS:
        of = {row["case"][0].split()[1]: row["detected_by"] for row in rows if row["case"][0].split()[0] == module}
        survivors = [limit for limit, test in of.items() if test is None]
        if of:
            yield [f"`{module}`", str(len(of)), str(len(of) - len(survivors)), ", ".join(survivors)]


TABLES = (Table("mutants", row_of, [(mutant.name,) for mutant in mutants()], show, alone=True),)


def main() -> None:
    """Run the limits whose names contain a text, and fail if one survives."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--only", default="", help="text in the names of modules or limits to run")
    only = parser.parse_args().only
    survivors = 0
    for mutant in mutants():
        if only in mutant.name:
            test = detected_by(mutant.name)
            survivors += test is None
            print(mutant.name, test or "SURVIVED", flush=True)
    sys.exit(survivors > 0)


if __name__ == "__main__":
    main()
