"""Repeats random rows of all pages: `make bench-check`. Fails if one differs by more than the allowed standard deviations.

Rows are repeated that have errors with standard deviations, of robots and programs that this machine has. Rounding of another
processor may change a plan, and with it a row by some standard deviations. A page without standard deviations is confirmed by
rows whose numbers are all the same.

    python benchmarks/check.py --confirm accuracy robots --rows 8    # if equal, the pages become current: `provenance.py`
"""

from __future__ import annotations

import argparse
import json
import os
import random
import sys
from collections.abc import Iterator
from importlib import import_module

from rows import Page, Row, Table, workers  # isort: skip - it limits the threads of NumPy
import numpy as np
from provenance import RESULTS, confirm_page

EQUAL = 1e-4  # [std]; rows are kept with six digits
MOST_TRIES = 5  # rows that may turn out to need something that this machine does not have, per repeated row


def repeatable() -> Iterator[tuple[Table, Row]]:
    """Yield all rows with a standard deviation, and their tables."""
    for file in sorted(RESULTS.glob("*.jsonl")):
        yield from ((table, row) for table, row in rows_of(file.stem) if "sd" in row)


def rows_of(page_name: str) -> Iterator[tuple[Table, Row]]:
    """Yield the rows of a page that can be made beside each other, and their tables."""
    page: Page = import_module(page_name).PAGE
    by_name = {table.name: table for table in page.tables}
    for row in page.read().values():
        table = by_name.get(row["key"].split("/")[0])
        if table is not None and not table.alone:
            yield table, row


def change(table: Table, row: Row) -> float | str | None:
    """Return the largest change of a repeated row, its error, or None if it was not tried.

    Returns:
        Change of its errors [standard deviations]; without standard deviations zero if all numbers are the same, or else
        infinity.
    """
    again = table.row(tuple(row["case"]), "")
    if again is None or "failed" in again:
        return None if again is None else again["failed"]
    if "sd" not in row:
        same = json.loads(json.dumps({**again, "commit": row["commit"]})) == row
        return 0.0 if same else np.inf
    before, now, sd = (
        np.array([np.nan if value is None else value for value in of], dtype=float)
        for of in (row["error"], again["error"], row["sd"])
    )
    return float(np.nanmax(np.abs(now - before) / sd))


def confirmed(name: str, count: int) -> bool:
    """Repeat random rows of a page; note it on the page if none differs by more than rounding."""
    rows = list(rows_of(name))
    rows = [(table, row) for table, row in rows if "sd" in row] or rows
    chosen = random.sample(rows, min(count, len(rows)))
    with workers(os.cpu_count() or 1) as pool:
        found = list(pool.map(change, *zip(*chosen, strict=True))) if chosen else []
    tried = [how for how in found if how is not None]
    equal = bool(tried) and all(isinstance(how, float) and how < EQUAL for how in tried)
    print(f"{name}: {len(tried)} rows tried, {'equal' if equal else f'not equal: {tried}'}", flush=True)
    if equal:
        confirm_page(f"{name}.md", len(tried))
    return equal


def main() -> None:
    """Repeat rows until enough were tried."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--rows", type=int, default=6, metavar="N", help="number of rows")
    parser.add_argument("--within", type=float, default=0.02, metavar="STD", help="allowed change")
    parser.add_argument(
        "--confirm", nargs="+", default=(), metavar="PAGE", help="pages to confirm, each by so many rows"
    )
    given = parser.parse_args()
    if given.confirm:
        equal = [confirmed(name, given.rows) for name in given.confirm]
        sys.exit(not all(equal))
    found = list(repeatable())
    chosen = random.sample(found, min(MOST_TRIES * given.rows, len(found)))
    tried = failed = 0
    with workers(os.cpu_count() or 1) as pool:
        while chosen and tried < given.rows:
            now = [chosen.pop() for _ in range(min(given.rows - tried, len(chosen)))]
            for (_, row), how in zip(now, pool.map(change, *zip(*now, strict=True)), strict=True):
                wrong = how is not None and (isinstance(how, str) or how > given.within)
                tried, failed = tried + (how is not None), failed + wrong
                text = "not tried" if how is None else how if isinstance(how, str) else f"differs by {how:.2g} std"
                print(row["key"], text, flush=True)
    print(f"{tried - failed} of {tried} rows are within {given.within:g} std")
    sys.exit(not tried or failed > 0)


if __name__ == "__main__":
    main()
