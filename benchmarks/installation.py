"""Tables of the page `speed`: size of an installation by package, and `make demo` and `make test` in a fresh clone.

Sizes are those of the installed files in this environment; nothing is downloaded for them.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from provenance import ROOT
from rows import NotTriedError, Row, Table
from tables import figures, markdown

import equipoise

EXTRAS = (
    "", "desk", "simulation", "report", "logs", "parquet", "monte-carlo", "dask", "view", "dds", "dart", "robots"
)  # fmt: skip
HEADERS = "/cmeel.prefix/include/"
MOST_SIZE, LEAST_SHOWN = 400, 1.0  # [MB] of a plain installation; of a package in the table
FRESH = {"demo": 45.0, "test": 480.0}  # [s]


def needed(package: Distribution, extras: Iterable[str]) -> Iterator[tuple[str, set[str]]]:
    """Yield the dependencies of a package with their extras."""
    for line in package.requires or ():
        asked = Requirement(line)
        if asked.marker is None or any(asked.marker.evaluate({"extra": extra}) for extra in ("", *extras)):
            yield canonicalize_name(asked.name), asked.extras


def closure(extras: Iterable[str] = ()) -> dict[str, set[str]]:
    """Return equipoise and all its dependencies, each with the packages that need it.

    Raises:
        PackageNotFoundError: one is not installed here.
    """
    taken: dict[str, set[str]] = {}
    needed_by: dict[str, set[str]] = {"equipoise": set()}
    waiting: list[tuple[str, set[str]]] = [("equipoise", set(extras))]
    while waiting:
        name, wanted = waiting.pop()
        if name not in taken or wanted - taken[name]:  # our extras refer to each other
            taken[name] = taken.get(name, set()) | wanted
            for other, more in needed(distribution(name), wanted):
                needed_by.setdefault(other, set()).update({name} - {other})
                waiting.append((other, more))
    return needed_by


def megabytes(package: Distribution, headers: bool = False) -> float:
    """Return the size of a package's files without bytecode, or of those for C++ compilers, which no verb reads."""
    if package.name == "equipoise":  # an editable installation has its files elsewhere
        files = [file for file in Path(equipoise.__file__).parent.rglob("*") if file.is_file()]
    else:
        files = [Path(str(file.locate())) for file in package.files or ()]
    if headers:
        files = [file for file in files if HEADERS in str(file)]
    return sum(file.stat().st_size for file in files if file.suffix != ".pyc" and file.is_file()) / 1e6


def size(extra: str) -> Row:
    """Return the size of each package that an extra adds, or of the plain installation [MB], and who needs it."""
    try:
        packages = closure([extra] if extra else [])
    except PackageNotFoundError as error:
        raise NotTriedError(f"{error.name} is not installed here") from error
    added = set(packages) - (set(closure()) if extra else set())
    return {
        "packages": {name: [megabytes(distribution(name)), sorted(packages[name])] for name in sorted(added)},
        "headers": sum(megabytes(distribution(name), headers=True) for name in added),
    }


def show_size(rows: list[Row]) -> Iterator[str]:
    sizes = {row["case"][0]: row["packages"] for row in rows}
    total = {extra: sum(megabytes for megabytes, _ in of.values()) for extra, of in sizes.items()}
    yield "## Size of an installation"
    yield ""
    yield (
        f"Installed files in MB, without bytecode and interpreter; Python {sys.version.split()[0]}. `pip install equipoise` "
        "is for a robot's computer: it calibrates and estimates without simulator, figures and bag readers. `make install` "
        "installs `[desk]`."
    )
    yield ""
    plain = sorted(sizes.get("", {}).items(), key=lambda item: -item[1][0])
    lines = [[name, f"{size:.0f}", ", ".join(users) or "-"] for name, (size, users) in plain if size >= LEAST_SHOWN]
    rest = sum(size for _, (size, _) in plain if size < LEAST_SHOWN)
    if plain:
        without = total[""] - next(row["headers"] for row in rows if row["case"] == [""])
        head = ("package of `pip install equipoise`", "MB", "needed by")
        yield from markdown(
            head,
            [
                *lines,
                ["others", f"{rest:.0f}", ""],
                [f"all (target: {MOST_SIZE})", figures(total[""], ".0f", MOST_SIZE), ""],
                [
                    f"all, without `{HEADERS[1:-1]}`",
                    figures(without, ".0f", MOST_SIZE),
                    "C++ compilers need that folder",
                ],
            ],
        )
        yield ""
    yield from markdown(("extra", "MB more", "largest packages"), _extra_lines(sizes, total))


def _extra_lines(sizes: dict[str, dict[str, list]], total: dict[str, float]) -> Iterator[list[str]]:
    for extra, of in sizes.items():
        if extra:
            largest = sorted(of.items(), key=lambda item: -item[1][0])[:3]
            yield [
                f"`[{extra}]`",
                f"{total[extra]:.0f}",
                ", ".join(f"{name} {size:.0f}" for name, (size, _) in largest),
            ]


def fresh(target: str) -> Row:
    """Return the wall time of a target of the Makefile in a clone of this repository without environment [s]."""
    if "fresh" not in sys.argv:
        raise NotTriedError("it takes half an hour; use --only fresh")
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(["git", "clone", "--quiet", str(ROOT), folder], check=True)
        start = time.perf_counter()
        done = subprocess.run(["make", target], cwd=folder, capture_output=True, text=True, check=False)
        row: Row = {"wall": time.perf_counter() - start}
    return row if done.returncode == 0 else {**row, "failed": (done.stdout + done.stderr)[-500:]}


def show_fresh(rows: list[Row]) -> Iterator[str]:
    yield "## In a fresh clone"
    yield ""
    yield "Wall time with the download of all packages; `python benchmarks/speed.py --only fresh`."
    yield ""
    lines = [
        [f"`make {row['case'][0]}`", figures(row["wall"], ".0f", FRESH[row["case"][0]]), f"{FRESH[row['case'][0]]:g}"]
        for row in rows
    ]
    yield from markdown(("command", "wall time [s]", "target"), lines)


TABLES = (
    Table("size", size, [(extra,) for extra in EXTRAS], show_size, alone=True),
    Table("fresh", fresh, [(target,) for target in FRESH], show_fresh, alone=True),
)
