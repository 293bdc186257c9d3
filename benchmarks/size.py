"""What an installation weighs: `make bench-size`. Writes benchmarks/results/size.md.

The files that packages of this environment brought are counted, with all that they need in turn: nothing is downloaded.
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
    """What a package needs, and with which extras."""
    for line in package.requires or ():
        asked = Requirement(line)
        wanted = asked.marker is None or any(asked.marker.evaluate({"extra": extra}) for extra in ("", *extras))
        if wanted:
            yield canonicalize_name(asked.name), asked.extras


def closure(extras: tuple[str, ...] = ()) -> dict[str, float]:
    """Sizes of equipoise and of all that it needs [MB], by name.

    Raises:
        PackageNotFoundError: an extra is not installed here.
    """
    taken: dict[str, set[str]] = {}
    waiting: list[tuple[str, set[str]]] = [("equipoise", set(extras))]
    while waiting:
        name, wanted = waiting.pop()
        if name not in taken or wanted - taken[name]:  # extras of ours name others of ours
            taken[name] = taken.get(name, set()) | wanted
            waiting += needed(distribution(name), wanted)
    return {name: megabytes(distribution(name)) for name in taken}


def megabytes(package: Distribution) -> float:
    """What its files take, bytecode left out."""
    if package.name == "equipoise":  # in development its files are elsewhere
        files = [file for file in Path(equipoise.__file__).parent.rglob("*") if file.is_file()]
    else:
        files = [Path(str(file.locate())) for file in package.files or ()]
    counted = (file for file in files if file.suffix != ".pyc" and file.is_file())
    return sum(file.stat().st_size for file in counted) / 1e6


def extra_row(extra: str, plain: dict[str, float]) -> str:
    """What an extra adds."""
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
        "# What an installation weighs",
        "",
        f"`make bench-size`; equipoise {equipoise.__version__}, Python {platform.python_version()} on "
        f"{platform.machine()}. Files that packages bring, in MB, bytecode left out; an interpreter is not counted.",
        "",
        "| install | MB | of that |",
        "|---|---|---|",
        f"| `pip install equipoise` | {total:.0f} | {', '.join(f'{n} {s:.0f}' for n, s in largest_of(plain, 8))} |",
        *(extra_row(extra, plain) for extra in EXTRAS),
        "",
        f"Target for a robot's computer: {TARGET} MB, {verdict} by the plain install, which calibrates and estimates without "
        "simulator, pictures and readers of bags; `make install` installs `[desk]`, which is all three.",
    ]
    text = "\n".join(lines) + "\n"
    write_page("size.md", text)
    print(text)


if __name__ == "__main__":
    main()
