"""Figures and lines of tables in Markdown."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from rows import Row

from equipoise.result.statistics import NORMAL_95

SILENT = 4.0
"""Error in standard deviations that a check must detect."""


def markdown(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> list[str]:
    """Return the lines of a table."""
    lines = [head, ["---"] * len(head), *rows]
    return [f"| {' | '.join(str(cell) for cell in line)} |" for line in lines]


def rms(values: Any) -> Any:
    """Return the root mean square over the first axis."""
    return np.sqrt(np.mean(np.square(np.asarray(values, dtype=float)), axis=0))


def figures(values: Any, form: str = ".2f", most: Any = np.inf) -> str:
    """Return numbers separated by spaces, bold above the largest allowed ones; "-" for nan."""
    values = np.atleast_1d(np.asarray(values, dtype=float))
    limits = np.broadcast_to(np.asarray(most, dtype=float), values.shape)
    return " ".join(
        "-" if np.isnan(value) else f"**{value:{form}}**" if value > limit else f"{value:{form}}"
        for value, limit in zip(values, limits, strict=True)
    )


def column(rows: Iterable[Row], name: str) -> np.ndarray:
    """Return the (n, ...) numbers of a column; None becomes nan."""
    return np.array([row[name] for row in rows], dtype=float)


def relative(rows: Sequence[Row], name: str = "error") -> np.ndarray:
    """Return (n, 10) errors: mass [%], CoM [mm], moments [%], products [% of Ixx]; a row has its "truth"."""
    truth = column(rows, "truth")
    unit = np.hstack([100 / truth[:, :1], np.full((len(truth), 3), 1e3), 100 / truth[:, 4:7], 100 / truth[:, [4] * 3]])
    return column(rows, name) * unit


def coverage(rows: Iterable[Row], least: float = 0.0) -> str:
    """Return the share of 95 % intervals that contain the truth, by the rows' "holds"; bold below the least allowed one."""
    share = float(np.mean(np.concatenate([row["holds"] for row in rows])))
    return f"{share:.0%}" if share >= least else f"**{share:.0%}**"


def failed_checks(rows: Sequence[Row]) -> str:
    """Return the number of rows with a failed check, and the number of each."""
    counts = Counter(name for row in rows for name in row["alarms"])
    named = ", ".join(f"{name} {count}" for name, count in counts.most_common())
    return f"{sum(bool(row['alarms']) for row in rows)} {named}".strip()


def interval_of_share(share: float, count: float) -> str:
    """Return a share with its 95 % interval by Wilson's formula (1927)."""
    z2 = NORMAL_95**2
    middle = (share + z2 / (2 * count)) / (1 + z2 / count)
    half = NORMAL_95 / (1 + z2 / count) * np.sqrt(share * (1 - share) / count + z2 / (4 * count**2))
    return f"{share:.0%} ({max(middle - half, 0.0):.0%} to {min(middle + half, 1.0):.0%})"


def coverage_with_interval(rows: Sequence[Row], least: float = 0.0) -> str:
    """Return `coverage` with its 95 % interval, widened by the spread of the runs' shares: values of a run correlate.

    If all or no intervals contain the truth, the spread says nothing of that, and each run counts once.
    """
    holds = np.array([row["holds"] for row in rows])
    share, spread = holds.mean(), holds.mean(axis=1).var(ddof=1) / len(holds) if len(holds) > 1 else 0.0
    count = min(holds.size, share * (1 - share) / spread) if spread else holds.size if 0 < share < 1 else len(holds)
    text = interval_of_share(share, count)
    return text if share >= least else f"**{text}**"


def deviation(row: Row) -> float:
    """Return the largest error [standard deviations]."""
    return float(np.abs(column([row], "error") / column([row], "sd")).max())


def is_silent(row: Row) -> bool:
    """Return true for a large error without a failed check."""
    return not row["alarms"] and deviation(row) > SILENT
