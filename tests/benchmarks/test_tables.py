"""Intervals of shares on results pages."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))  # last: some names equal those of tests
from tables import coverage_with_interval, interval_of_share


def test_interval_of_coverage_counts_runs_if_the_values_of_a_run_agree_and_values_if_not():
    agreeing = [{"holds": [held] * 10} for held in 8 * [True] + 2 * [False]]
    assert coverage_with_interval(agreeing) == interval_of_share(
        0.8, 9
    )  # less than the runs: their spread is estimated
    alike = [{"holds": 8 * [True] + 2 * [False]}] * 10
    assert coverage_with_interval(alike) == interval_of_share(0.8, 100) == "80% (71% to 87%)"
