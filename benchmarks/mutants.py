"""Whether every limit has a test that bites: `make mutants`. Writes benchmarks/results/mutants.md.

Each limit of the guard, its endings, the second connection and the doctor is loosened by half in a copy of the package, and
the tests that concern it are run on the copy. A mutant is detected if a test fails; one that survives shows a limit without a
test.
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
from pathlib import Path

from provenance import commit, write_page

ROOT = Path(__file__).parents[1]
RESULTS = Path(__file__).parent / "results"
LOOSER = 1.5
PATIENCE = 300.0  # [s] for the tests of one mutant: what does not end has been noticed, too

# By module: tests that concern it, limits that are looser when they are larger, and when they are smaller.
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
    "guard/tilt_filter.py": ("guard/test_limits.py guard/test_tilt_filter.py", "_TIME _BELIEVED", ""),
    "guard/force_limit.py": ("guard/test_limits.py", "_GENTLE _RATE", ""),
    "guard/robot_loop.py": ("guard/test_limits.py", "", "_LOOK_TIME"),
    "guard/soft_start.py": ("guard/test_limits.py", "", "SOFT_START"),
    "guard/endings.py": (
        "guard/test_limits.py",
        "_LOWERING _SPEED_SHARE _FALLEN _FAR STILL _SILENT",
        "FEET_DOWN LIE_DOWN FADE _MOVED DAMPED_TIME STILL_TIME _LONGEST",
    ),
    "guard/second_connection.py": ("guard/test_limits.py", "_AGAIN", "_REACHED"),
    "drivers/checkup.py": (
        "drivers/test_checkup_limits.py drivers/test_checkup.py",
        "_PATIENCE _JITTER _LEAN _ASKEW _BIAS _STILL _BEYOND _MASS_RANGE[1] _HOT",
        "_SLOWEST _USUAL _MASS_RANGE[0] _WEAK_BATTERY",
    ),
    "clearance/pairs.py": ("clearance/test_clearance.py", "", "_LEAST"),
}


@dataclass(frozen=True)
class Mutant:
    """A limit that is looser than it should be.

    Attributes:
        module: path of the module in the package.
        limit: name of the limit; with an index where it is one of several.
        factor: factor by which it is looser.
        tests: paths of the tests that concern it.
    """

    module: str
    limit: str
    factor: float
    tests: tuple[str, ...]

    def apply(self, source: str) -> str:
        """The module's text with the looser limit; raises LookupError if it has none of that name."""
        name, _, index = self.limit.rstrip("]").partition("[")
        for node in ast.walk(ast.parse(source)):
            value = _assigned(node, name)
            if isinstance(value, ast.Tuple) and index:
                value = value.elts[int(index)]
            if value is not None:
                return _replaced(source, value, f"({ast.unparse(value)}) * {self.factor!r}")
        raise LookupError(f"{self.module} has no limit {self.limit}")


def _assigned(node: ast.AST, name: str) -> ast.expr | None:
    """What a statement gives to a name, alone or among others."""
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
    """All of them."""
    for module, (tests, larger, smaller) in LIMITS.items():
        for names, factor in ((larger, LOOSER), (smaller, 1 / LOOSER)):
            for limit in names.split():
                yield Mutant(module, limit, factor, tuple(f"tests/{test}" for test in tests.split()))


def killer(mutant: Mutant, package: Path) -> str | None:
    """The test that notices a mutant in a copy of the package, which is put right again; None if it survives."""
    path = package / mutant.module
    sound = path.read_text(encoding="utf-8")
    path.write_text(mutant.apply(sound), encoding="utf-8")
    try:
        return _failing(mutant.tests, package.parent)
    finally:
        path.write_text(sound, encoding="utf-8")


def _failing(tests: tuple[str, ...], source: Path) -> str | None:
    environment = {**os.environ, "PYTHONPATH": str(source), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests]
    try:
        done = subprocess.run(
            command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False, timeout=PATIENCE
        )
    except subprocess.TimeoutExpired:
        return "they did not end"
    if done.returncode == 0:
        return None
    failed = re.search(r"^(?:FAILED|ERROR) tests/([^\s\[]+)", done.stdout, re.MULTILINE)
    if failed is None:
        raise SystemExit(done.stdout + done.stderr)
    return failed[1].rpartition("::")[2]


def main() -> None:
    """The limits whose names hold a word, or all; only of all a page is written."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only-effects", default="", help="modules and limits in whose names this is")
    only = parser.parse_args().only
    rows: list[tuple[Mutant, str | None]] = []
    made_at = commit()
    with tempfile.TemporaryDirectory() as folder:
        package = Path(shutil.copytree(ROOT / "src", Path(folder) / "src")) / "equipoise"
        every = [test for tests, _, _ in LIMITS.values() for test in tests.split()]
        sound = _failing(tuple(f"tests/{test}" for test in dict.fromkeys(every)), package.parent)
        if sound is not None:
            raise SystemExit(f"{sound} fails on the package as it is: nothing can be told")
        for mutant in mutants():
            if only in f"{mutant.module} {mutant.limit}":
                rows.append((mutant, killer(mutant, package)))
                print(*line(*rows[-1]), flush=True)
    if not only:
        write_page("mutants.md", page(rows), [{"commit": made_at}])
    sys.exit(any(test is None for _, test in rows))


def line(mutant: Mutant, test: str | None) -> tuple[str, str, str]:
    """Module, limit and what became of it."""
    return mutant.module, mutant.limit, "**survived**" if test is None else test


def page(rows: list[tuple[Mutant, str | None]]) -> str:
    """As Markdown."""
    noticed = sum(test is not None for _, test in rows)
    return "\n".join(
        [
            "# Limits that are looser than they should be",
            "",
            "`make mutants`. Each limit of the guard, its endings, the second connection and the doctor is loosened by "
            "half, times 1.5 or over it, and the tests that concern it are run: a test that fails has noticed. "
            f"{noticed} of {len(rows)} are noticed.",
            "",
            "| module | limit | noticed by |",
            "|---|---|---|",
            *(f"| {' | '.join(line(mutant, test))} |" for mutant, test in rows),
            "",
        ]
    )


if __name__ == "__main__":
    main()
