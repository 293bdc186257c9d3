"""Rows of a study on disk: reading, errors and interruptions."""

import dataclasses
import errno
import json
import os

import pyarrow as arrow
import pytest
from pyarrow import parquet
from studies import STATIC

from equipoise import PaperMethod
from equipoise.errors import OutputError, RecordingError, SettingsError
from equipoise.lab.static.method import Static
from equipoise.lab.study import store as store_module
from equipoise.lab.study.rows import COLUMNS, table_of
from equipoise.lab.study.store import TrialStore, read_rows
from equipoise.lab.study.trial import run_trial

BOTH = dataclasses.replace(STATIC, methods=(Static(), PaperMethod()))
NAMES = ("static", "paper")


def rows(*trials, methods=("static",), **others):
    return table_of([{"trial": t, "method": m, "status": "ok", **others} for t in trials for m in methods])


def parts(store):
    return sorted((store.folder / "trials").glob("*.parquet"))


def numbers(folder):
    return read_rows(folder)["trial"].to_pylist()


def test_rows_are_read_back_unchanged(tmp_path):
    store = TrialStore(tmp_path / "study", STATIC)
    made = run_trial(STATIC, 0)
    store.add(made)
    store.flush()
    assert store.rows().equals(made)
    assert made.schema == COLUMNS
    assert parquet.read_table(store.folder / "trials").num_rows == 1  # as other programs read it


def test_lists_texts_and_missing_values_are_read_back(tmp_path):
    store = TrialStore(tmp_path / "study", STATIC)
    store.add(rows(3, iteration_x=[0.1, 0.2], message="tipped\n«over»", trustworthy=False, lifts=7))
    store.flush()
    (row,) = store.rows().to_pylist()
    assert (row["iteration_x"], row["message"], row["trustworthy"], row["lifts"]) == (
        [0.1, 0.2], "tipped\n«over»", False, 7,
    )  # fmt: skip
    assert row["estimated_mass"] is None


def test_rows_are_in_order_each_once(tmp_path):
    store = TrialStore(tmp_path / "study", BOTH)
    for trial in (5, 2, 9):
        store.add(rows(trial, methods=NAMES))
        store.flush()
    store.add(rows(2, methods=NAMES, message="again"))
    store.flush()
    found = [(row["trial"], row["method"]) for row in store.rows().to_pylist()]
    assert found == [(trial, method) for trial in (2, 5, 9) for method in ("paper", "static")]


def test_a_study_is_resumed(tmp_path):
    store = TrialStore(tmp_path / "study", STATIC)
    store.add(rows(0, 4))
    assert store.done == {0, 4}
    store.flush()
    again = TrialStore(tmp_path / "study", STATIC)
    assert again.done == {0, 4}
    again.flush()
    assert len(parts(again)) == 1  # no rows were waiting


def test_another_study_raises_an_error_that_names_the_difference(tmp_path):
    TrialStore(tmp_path / "study", STATIC)
    with pytest.raises(SettingsError, match=r"another study \(it differs in preset, seed\).*another --out"):
        TrialStore(tmp_path / "study", dataclasses.replace(STATIC, seed=1, preset="ideal"))


def test_a_folder_with_other_files_raises_an_error(tmp_path):
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(OutputError, match="contains other files; name a new one with --out"):
        TrialStore(tmp_path, STATIC)
    assert os.listdir(tmp_path) == ["thesis.tex"]


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="cannot write into"):
        TrialStore(tmp_path / "file" / "study", STATIC)


@pytest.mark.parametrize("text", ["{", "[]", '{"schema": "equipoise.run/1"}'])
def test_an_invalid_header_raises_an_error(tmp_path, text):
    (tmp_path / "study.json").write_text(text, encoding="utf-8")
    with pytest.raises(RecordingError, match=r"study\.json"):
        read_rows(tmp_path)


def test_a_folder_without_a_study_raises_an_error(tmp_path):
    with pytest.raises(RecordingError, match="is not a Monte Carlo study"):
        read_rows(tmp_path)


@pytest.mark.parametrize("length", [0, 100, -200])
def test_a_damaged_part_is_named(tmp_path, length):
    store = TrialStore(tmp_path / "study", STATIC)
    for trial in range(2):
        store.add(rows(trial))
        store.flush()
    damaged = parts(store)[1]
    damaged.write_bytes(damaged.read_bytes()[:length])
    with pytest.raises(RecordingError) as caught:
        TrialStore(tmp_path / "study", STATIC)
    assert damaged.name in str(caught.value)
    assert "remove it to repeat its trials" in str(caught.value)
    damaged.unlink()
    assert TrialStore(tmp_path / "study", STATIC).done == {0}


def test_other_tables_are_ignored(tmp_path):
    store = TrialStore(tmp_path / "study", STATIC)
    store.add(rows(0))
    store.flush()
    parquet.write_table(arrow.table({"x": [1]}), store.folder / "trials" / "analysis.parquet")
    assert TrialStore(tmp_path / "study", STATIC).done == {0}


def test_an_unfinished_part_is_ignored(tmp_path):
    store = TrialStore(tmp_path / "study", STATIC)
    store.add(rows(0))
    store.flush()
    (store.folder / ".part-00000001-7-abc.parquet").write_bytes(b"PAR1 half")
    (store.folder / "trials" / ".part-00000001-7-abc.parquet").write_bytes(b"PAR1 half")
    assert TrialStore(tmp_path / "study", STATIC).done == {0}


def test_rows_that_cannot_be_written_are_kept_for_another_try(tmp_path, monkeypatch):
    store = TrialStore(tmp_path / "study", STATIC)
    store.add(rows(0))

    def full(*_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(store_module.parquet, "write_table", full)
        with pytest.raises(OutputError, match=r"cannot write .*part-00000000.*No space left"):
            store.flush()
    store.add(rows(1))
    store.flush()
    assert numbers(store.folder) == [0, 1]


@pytest.mark.skipif(os.geteuid() == 0, reason="root writes anywhere")
def test_a_folder_that_turned_read_only(tmp_path):
    store = TrialStore(tmp_path / "study", STATIC)
    store.add(rows(0))
    store.folder.chmod(0o500)
    try:
        with pytest.raises(OutputError, match="Permission denied"):
            store.flush()
    finally:
        store.folder.chmod(0o700)
    store.flush()
    assert numbers(store.folder) == [0]


def test_rows_are_written_after_some_seconds(tmp_path, monkeypatch):
    now = [100.0]
    monkeypatch.setattr(store_module.time, "monotonic", lambda: now[0])
    store = TrialStore(tmp_path / "study", STATIC)
    store.add(rows(0))
    store.flush_if_due()
    assert numbers(store.folder) == []
    now[0] += 5.1  # no other row came
    store.flush_if_due()
    assert numbers(store.folder) == [0]


def test_two_processes_can_write_into_one_folder(tmp_path):
    one, other = (TrialStore(tmp_path / "study", STATIC) for _ in range(2))
    for store in (one, other):
        store.add(rows(0, 1))
        store.flush()
    assert len(parts(one)) == 2
    assert numbers(one.folder) == [0, 1]


def test_the_header_contains_the_study(tmp_path):
    TrialStore(tmp_path / "study", STATIC)
    header = json.loads((tmp_path / "study" / "study.json").read_text(encoding="utf-8"))
    assert header["study"] == STATIC.to_dict()
    assert header["fingerprint"] == STATIC.fingerprint
