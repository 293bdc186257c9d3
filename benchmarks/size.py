"""Size of an installation: `make bench-size`. Writes benchmarks/results/size.md.

The installed files of equipoise and all its dependencies in this environment are counted; nothing is downloaded.
"""

from __future__ import annotations

import platform
from collections.abc import Iterable, Iterator
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from provenance import write_page

import equipoise

RESULTS = Path(__file__).parent / "results"
EXTRAS = (
    "desk", "simulation", "report", "logs", "parquet", "monte-carlo", "dask", "view", "dds", "dart", "robots"
)  # fmt: skip
TARGET = 720  # [MB]


def needed(package: Distribution, extras: Iterable[str]) -> Iterator[tuple[str, set[str]]]:
    """Return the dependencies of a package with their extras."""
    for line in package.requires or ():
        asked = Requirement(line)
        wanted = asked.marker is None or any(asked.marker.evaluate({"extra": extra}) for extra in ("", *extras))
        if wanted:
            yield canonicalize_name(asked.name), asked.extras


def closure(extras: tuple[str, ...] = ()) -> dict[str, float]:
    """Return the sizes of equipoise and its dependencies [MB], by name.

    Raises:
        PackageNotFoundError: an extra is not installed here.
    """
    taken: dict[str, set[str]] = {}
    waiting: list[tuple[str, set[str]]] = [("equipoise", set(extras))]
    while waiting:
        name, wanted = waiting.pop()
        if name not in taken or wanted - taken[name]:  # our extras refer to each other
            taken[name] = taken.get(name, set()) | wanted
            waiting += needed(distribution(name), wanted)
    return {name: megabytes(distribution(name)) for name in taken}


def megabytes(package: Distribution) -> float:
    """Return the size of a package's files without bytecode."""
    if package.name == "equipoise":  # an editable installation has its files elsewhere
        files = [file for file in Path(equipoise.__file__).parent.rglob("*") if file.is_file()]
    else:
        files = [Path(str(file.locate())) for file in package.files or ()]
    counted = (file for file in files if file.suffix != ".pyc" and file.is_file())
    return sum(file.stat().st_size for file in counted) / 1e6


def extra_row(extra: str, plain: dict[str, float]) -> str:
    """Return the table line of an extra."""
    try:
        more = {name: size for name, size in closure((extra,)).items() if name not in plain}
    except PackageNotFoundError as error:
        return f"| `[{extra}]` | not installed here: {error.name} | |"
    largest = ", ".join(f"{name} {size:.0f}" for name, size in largest_of(more, 3))
    return f"| `[{extra}]` | + {sum(more.values()):.0f} | {largest} |"


def largest_of(sizes: dict[str, float], count: int) -> list[tuple[str, float]]:
    return sorted(sizes.items(), key=lambda item: -item[1])[:count]


def main() -> None:
    plain = closure()
    total = sum(plain.values())
    verdict = "met" if total <= TARGET else "**missed**"
    lines = [
        "# Size of an installation",
        "",
        f"`make bench-size`; equipoise {equipoise.__version__}, Python {platform.python_version()} on "
        f"{platform.machine()}. Installed files in MB, without bytecode and interpreter.",
        "",
        "| install | MB | largest packages |",
        "|---|---|---|",
        f"| `pip install equipoise` | {total:.0f} | {', '.join(f'{n} {s:.0f}' for n, s in largest_of(plain, 8))} |",
        *(extra_row(extra, plain) for extra in EXTRAS),
        "",
        f"Target for a robot's computer: {TARGET} MB, {verdict} by the plain install, which calibrates and estimates without "
        "simulator, figures and bag readers; `make install` installs `[desk]`, which includes all three.",
    ]
    text = "\n".join(lines) + "\n"
    write_page("size.md", text)
    print(text)


if __name__ == "__main__":
    main()
