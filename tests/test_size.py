"""Budgets of size.toml for lines, classes and text, which only decrease."""

import code_size
import pytest

TARGET_LINES, TARGET_CLASSES = 29_500, 250  # of the core and the lab together; public classes
BUDGETS = code_size.budgets()
ROWS = [(table, name) for table, rows in BUDGETS.items() for name in rows]


@pytest.mark.parametrize(("table", "name"), ROWS, ids=lambda part: part)
def test_it_stays_within_its_budget(table, name):
    found, (budget, _) = code_size.measured()[table].get(name, 0), BUDGETS[table][name]
    assert found <= budget, f"{name}: {found} {table}, {budget} budgeted. Delete something, or say in size.toml why not"


@pytest.mark.parametrize(("table", "name"), ROWS, ids=lambda part: part)
def test_a_budget_follows_what_was_deleted(table, name):
    found, (budget, _) = code_size.measured()[table].get(name, 0), BUDGETS[table][name]
    assert found >= budget - code_size.slack(table, budget), f"{name}: {found} {table}; `make size` lowers the budget"


def test_every_package_has_a_budget():
    for table in ("lines", "classes"):
        assert set(code_size.measured()[table]) <= set(BUDGETS[table])


def test_targets_add_up():
    lines = sum(target for name, (_, target) in BUDGETS["lines"].items() if name != "benchmarks")
    assert lines == TARGET_LINES
    assert BUDGETS["reading"]["public_classes"][1] == TARGET_CLASSES
