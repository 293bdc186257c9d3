"""Rows and text of a results page.

A module of a page has a PAGE of several tables and ends with `main(PAGE)`. Each case of a table gives a row, which is kept in
results/NAME.jsonl, so that an interrupted benchmark continues. The page is results/NAME.md.

    python benchmarks/NAME.py                # missing cases, then the page
    python benchmarks/NAME.py --part 0.1     # the first tenth of each table's cases
    python benchmarks/NAME.py --only go2     # cases whose key contains a word
    python benchmarks/NAME.py --text         # the page from the rows that exist
    python benchmarks/NAME.py --again        # without the rows that exist
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import warnings
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import as_completed
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

for _name in (
    "OPENBLAS_NUM_THREADS",
    "OMP_NUM_THREADS",
    "MKL_NUM_THREADS",
):  # one core per case; before NumPy is imported
    os.environ[_name] = "1"

import numpy as np
from provenance import RESULTS, commit, write_page

from equipoise.errors import EquipoiseError, MissingDependencyError
from equipoise.lab.study.processes import Processes

Row = dict[str, Any]
Case = tuple[Any, ...]


class NotTriedError(Exception):
    """A case needs something that this machine does not have; its row is left out."""


@dataclass(frozen=True)
class Table:
    """Cases of one kind, and their text.

    Attributes:
        name: name of the table, the first part of its rows' keys.
        run: function of a case's values that returns a row; it is called in a worker process.
        cases: values of each case, JSON values, in the order in which `--part` takes them: vary seeds last.
        show: function from the rows of finished cases to lines of Markdown.
        alone: True if nothing else may run meanwhile, as for a timing or in real time.
    """

    name: str
    run: Callable[..., Row]
    cases: Sequence[Case]
    show: Callable[[list[Row]], Iterable[str]]
    alone: bool = False

    def key(self, case: Iterable[Any]) -> str:
        """Return the key of a case."""
        return "/".join(map(str, (self.name, *case)))

    def row(self, case: Case, made_at: str) -> Row | None:
        """Return the row of a case; None if it cannot be tried here."""
        row: Row = {"key": self.key(case), "case": list(case), "commit": made_at}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                return rounded({**row, **self.run(*case)})
            except (NotTriedError, MissingDependencyError) as error:
                print(f"{row['key']}: NOT TRIED: {error}", flush=True)
                return None
            except EquipoiseError as error:
                return {**row, "failed": f"{type(error).__name__}: {error}"}


@dataclass(frozen=True)
class Page:
    """Results page.

    Attributes:
        name: name of the page and of its module.
        about: title and first paragraph.
        tables: tables in their order on the page.
        notes: text after the tables.
    """

    name: str
    about: str
    tables: tuple[Table, ...]
    notes: str = ""

    @property
    def file(self) -> Path:
        """File of the rows."""
        return RESULTS / f"{self.name}.jsonl"

    def read(self) -> dict[str, Row]:
        """Return the latest row of each key."""
        text = self.file.read_text(encoding="utf-8") if self.file.exists() else ""
        return {row["key"]: row for row in map(json.loads, text.splitlines())}

    def text(self, rows: dict[str, Row]) -> str:
        """Return the page's text."""
        kept = {table.name: [rows[key] for key in map(table.key, table.cases) if key in rows] for table in self.tables}
        finished = {name: [row for row in of if "failed" not in row] for name, of in kept.items()}
        lines = [self.about.strip()]
        for table in self.tables:
            if finished[table.name]:
                lines += ["", *table.show(finished[table.name])]
        lines += ["", self.notes.strip()] if self.notes else []
        failed = [f"- {row['key']}: {row['failed']}" for of in kept.values() for row in of if "failed" in row]
        lines += ["", "## Runs that ended with an error", "", *failed] if failed else []
        return "\n".join(lines) + "\n"


def main(page: Page) -> None:
    """Run the missing cases of a page and write it."""
    parser = argparse.ArgumentParser(description=f"Makes benchmarks/results/{page.name}.md.")
    parser.add_argument("--part", type=float, default=1.0, metavar="SHARE", help="share of each table's cases")
    parser.add_argument("--only", default="", metavar="WORD", help="cases whose key contains this")
    parser.add_argument("--text", action="store_true", help="write the page from the rows that exist")
    parser.add_argument("--again", action="store_true", help="remove the rows that exist first")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="number of worker processes")
    given = parser.parse_args()
    if given.again:
        page.file.unlink(missing_ok=True)
    rows = page.read()
    wanted = [] if given.text else [one for one in in_turn(page.tables, given.part) if one[0].key(one[1]) not in rows]
    try:
        with closing(run_all([one for one in wanted if given.only in one[0].key(one[1])], given.jobs)) as made:
            for row in made:
                rows[row["key"]] = row
                with page.file.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(row) + "\n")
                print(row["key"], row.get("failed", ""), flush=True)
    except KeyboardInterrupt:
        print("interrupted; finished rows are kept, and the same command makes the missing ones")
        sys.exit(130)
    text = page.text(rows)
    known = {table.key(case) for table in page.tables for case in table.cases}
    write_page(f"{page.name}.md", text, [row for key, row in rows.items() if key in known])
    print(text)


def in_turn(tables: Iterable[Table], part: float = 1.0) -> list[tuple[Table, Case]]:
    """Return all cases, those of all tables mixed evenly; cases that run alone last."""
    placed = [
        (table.alone, place / len(table.cases), number, table, case)
        for number, table in enumerate(tables)
        for place, case in enumerate(table.cases[: round(part * len(table.cases))])
    ]
    return [(table, case) for *_, table, case in sorted(placed, key=lambda one: one[:3])]


@contextmanager
def workers(count: int) -> Generator[Processes]:
    """Yield worker processes, which end with the context, also in the middle of their calls."""
    pool = Processes(count)
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def run_all(wanted: Sequence[tuple[Table, Case]], jobs: int) -> Generator[Row]:
    """Yield the rows of cases as they finish; those of tables that run alone one by one at the end."""
    made_at = commit()
    together = [(table, case) for table, case in wanted if not table.alone]
    with workers(jobs) as pool:
        for future in as_completed([pool.submit(table.row, case, made_at) for table, case in together]):
            if (row := future.result()) is not None:
                yield row
    for table, case in wanted:
        if table.alone and (row := table.row(case, made_at)) is not None:
            yield row


def rounded(value: Any) -> Any:
    """Return a JSON value of a row, with floats rounded to six digits, because rows are stored in the repository."""
    if isinstance(value, np.generic):
        return rounded(value.item())
    if isinstance(value, float):
        return float(f"{value:.6g}")
    if isinstance(value, dict):
        return {key: rounded(item) for key, item in value.items()}
    return [rounded(item) for item in value] if isinstance(value, list | tuple) else value
