"""Trials in processes: equal rows on any worker, each exactly once, also if workers die."""

import dataclasses
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool

import pytest
from studies import (
    STATIC,
    Inline,
    alive,
    cheap_trial,
    eventually,
    facts,
    rows_in,
    start_study,
    study_rows,
    trial_rows,
    wait_for,
)

from equipoise import ComSearchSettings, PaperMethod, RunFolder, errors
from equipoise.errors import EquipoiseError, OutputError, SettingsError
from equipoise.lab.study import runner, trial
from equipoise.lab.study.executors import ended_after
from equipoise.lab.study.runner import LOST
from equipoise.lab.study.study import Study
from equipoise.lab.study.trial import run_trial

POSIX = pytest.mark.skipif(os.name != "posix", reason="signals")


@pytest.fixture(scope="module")
def reference():
    """Rows of the first six trials, computed in this process in reversed order."""
    return [row for number in reversed(range(6)) for row in trial_rows(STATIC, number)][::-1]


@pytest.fixture
def cheap(monkeypatch):
    """Replace the trials of `run_study` and its processes by trials without a robot."""
    monkeypatch.setattr(runner, "run_trial", cheap_trial)


def numbers(rows):
    return [row["trial"] for row in rows]


def test_one_worker_many_workers_and_none_give_the_same_rows(reference, tmp_path):
    assert {row["status"] for row in reference} == {"ok"}
    rows = study_rows(STATIC, 6, tmp_path / "study", workers=2)
    assert facts(rows) == facts(reference)
    assert {row["worker"] for row in rows}.isdisjoint({os.getpid()})
    assert not multiprocessing.active_children()


def test_trials_in_threads_of_one_process_do_not_disturb_each_other(reference):
    """Threads share the robot's model and its scratch memory; a Dask worker has a thread per core by default."""
    with ThreadPoolExecutor(4) as threads:
        rows = [row for rows in threads.map(lambda number: trial_rows(STATIC, number), range(6)) for row in rows]
    assert facts(rows) == facts(reference)


def test_more_trials_extend_a_study(reference, tmp_path, monkeypatch):
    study_rows(STATIC, 3, tmp_path / "study", Inline())
    ran = []
    monkeypatch.setattr(runner, "run_trial", lambda *call: ran.append(call[1]) or run_trial(*call))
    rows = study_rows(STATIC, 6, tmp_path / "study", Inline())
    assert ran == [3, 4, 5]
    assert [facts([row])[0]["estimated_com_x"] for row in rows] == [row["estimated_com_x"] for row in reference]
    assert numbers(study_rows(STATIC, 2, tmp_path / "study", Inline())) == [0, 1]
    assert ran == [3, 4, 5]


def test_progress_counts_finished_trials(cheap, tmp_path):
    study_rows(STATIC, 2, tmp_path / "study", Inline())
    reports = []
    study_rows(STATIC, 5, tmp_path / "study", Inline(), report=reports.append)
    assert [(progress.done, progress.total) for progress in reports] == [(3, 5), (4, 5), (5, 5)]
    assert all(progress.rate > 0 for progress in reports)
    assert reports[-1].remaining == 0


def test_a_limit_of_zero_raises_an_error(tmp_path):
    with pytest.raises(SettingsError, match="the time limit of a trial is 0 s; it must be positive"):
        study_rows(STATIC, 1, tmp_path / "study", Inline(), limit=0.0)


@pytest.mark.parametrize(("trials", "workers"), [(0, 1), (-3, 1), (1, 0), (1, -2)])
def test_no_trials_and_no_workers_raise_an_error(trials, workers, tmp_path):
    with pytest.raises(SettingsError, match="it must be at least 1"):
        study_rows(STATIC, trials, tmp_path / "study", workers=workers)
    assert not (tmp_path / "study").exists()


def test_an_error_of_every_trial_leaves_no_folder(tmp_path):
    with pytest.raises(SettingsError, match="leaves nothing to search"):
        study_rows(
            Study(methods=(PaperMethod(com_search=ComSearchSettings(tolerance=0.9)),)), 1, tmp_path / "study", Inline()
        )
    assert not (tmp_path / "study").exists()


# --- calibrations that fail


def test_a_calibration_that_fails_is_a_row_and_keeps_its_recordings(tmp_path):
    coarse = PaperMethod(com_search=ComSearchSettings(tolerance=0.02))
    study = Study(methods=(coarse,), payload="3,0.8,0,0.08")  # the CoM lies far beyond the bounds of the search
    (row,) = study_rows(study, 1, tmp_path / "study", Inline())
    assert issubclass(getattr(errors, row["status"]), errors.MotionError)
    assert row["estimated_com_x"] is None
    assert row["true_com_x"] > 0.12
    assert "Traceback" not in row["message"]
    log = RunFolder.open(row["log"]).read()
    assert log.closed
    assert log.recordings or log.unfinished
    assert os.path.isabs(row["log"]), "a worker may run in another folder"


def test_the_log_of_a_trial_that_was_killed_before_its_row_was_written_is_replaced(tmp_path):
    study = dataclasses.replace(STATIC, payload="20,0.5,0,0.3")
    first, second = (trial_rows(study, 0, str(tmp_path / "failures")) for _ in range(2))
    assert first[0]["status"] == "FallError"
    assert second[0]["log"] == first[0]["log"] is not None


def test_a_worker_without_the_study_folder_does_not_create_it(tmp_path):
    study = dataclasses.replace(STATIC, payload="20,0.5,0,0.3")
    (row,) = trial_rows(study, 0, str(tmp_path / "elsewhere" / "failures"))
    assert (row["status"], row["log"]) == ("FallError", None)
    assert not (tmp_path / "elsewhere").exists()


@pytest.mark.parametrize("place", ["draw", "calibrate"])
def test_bugs_are_rows_with_a_traceback(place, monkeypatch, tmp_path):
    def faulty(*_):
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr(trial, place, faulty)
    rows = study_rows(STATIC, 2, tmp_path / "study", Inline())
    assert [row["status"] for row in rows] == ["ZeroDivisionError"] * 2
    assert "Traceback" in rows[0]["message"]
    assert "a bug" in rows[0]["message"]


# --- workers that die


@POSIX
def test_a_killed_worker_loses_no_trial(cheap, tmp_path):
    killed = []

    def kill_one(progress):
        if not killed:
            killed.append(multiprocessing.active_children()[0].pid)
            os.kill(killed[0], signal.SIGKILL)

    rows = study_rows(STATIC, 30, tmp_path / "study", workers=2, report=kill_one)
    assert numbers(rows) == list(range(30))
    assert {row["status"] for row in rows} == {"ok"}
    assert not multiprocessing.active_children()


@POSIX
def test_only_the_trial_that_always_kills_its_worker_is_lost(cheap, tmp_path, monkeypatch):
    monkeypatch.setenv("LETHAL_TRIAL", "2")
    reports = []
    rows = study_rows(STATIC, 7, tmp_path / "study", workers=2, report=reports.append)
    assert {row["trial"]: row["status"] for row in rows} == {n: LOST if n == 2 else "ok" for n in range(7)}
    assert "died twice" in rows[2]["message"]
    assert (reports[-1].done, reports[-1].failed) == (7, 1)


@POSIX
def test_a_trial_whose_worker_dies_once_runs_again(cheap, tmp_path, monkeypatch):
    monkeypatch.setenv("LETHAL_TRIAL", "0")
    monkeypatch.setenv("LETHAL_ONCE", str(tmp_path / "died"))
    rows = study_rows(STATIC, 1, tmp_path / "study", workers=1)
    assert [(row["trial"], row["status"]) for row in rows] == [(0, "ok")]


@POSIX
def test_only_a_trial_that_hangs_is_ended_and_lost(cheap, tmp_path, monkeypatch):
    monkeypatch.setenv("HANGING_TRIAL", "1")
    rows = study_rows(STATIC, 3, tmp_path / "study", workers=1, limit=1.0)
    assert [row["status"] for row in rows] == ["ok", LOST, "ok"]
    assert rows[1]["message"] == "its worker process died twice: out of memory, or time limit of 1 s exceeded"


def test_a_process_that_is_not_a_worker_is_not_ended():
    assert ended_after(1e-3, time.sleep, 0.05) is None


def test_workers_that_come_while_a_study_runs_are_used(tmp_path, monkeypatch):
    meeting, counts = threading.Barrier(12), iter([1])

    def together(study, trial, logs):
        if trial >= 3:
            meeting.wait(timeout=10)  # breaks unless 12 trials run at once
        return cheap_trial(study, trial, logs)

    monkeypatch.setattr(runner, "run_trial", together)
    with ThreadPoolExecutor(12) as threads:
        rows = study_rows(STATIC, 27, tmp_path / "study", threads, lambda: next(counts, 4))
    assert {row["status"] for row in rows} == {"ok"}


class Breaking(Inline):
    """Executor that breaks at a trial, like a pool whose worker has just died."""

    def submit(self, function, /, limit, run, study, trial, logs):
        if trial == 8:
            raise BrokenProcessPool("a child process terminated abruptly")
        return super().submit(function, limit, run, study, trial, logs)


class Cancelling(Inline):
    """Executor that cancels trials from a given one on, like Dask's client without its scheduler."""

    def submit(self, function, /, limit, run, study, trial, logs):
        if trial < 2:
            return super().submit(function, limit, run, study, trial, logs)
        future = Future()
        future.cancel()
        future.set_running_or_notify_cancel()
        return future


@pytest.mark.parametrize(("gone", "kept"), [(Breaking, 6), (Cancelling, 2)])
def test_a_broken_executor_ends_the_study_and_keeps_finished_trials(gone, kept, cheap, tmp_path):
    with pytest.raises(EquipoiseError, match="finished trials are kept"):
        study_rows(STATIC, 9, tmp_path / "study", gone(), workers=2)
    assert numbers(rows_in(tmp_path / "study")) == list(range(kept))
    assert numbers(study_rows(STATIC, 9, tmp_path / "study", Inline())) == list(range(9))


def test_workers_that_lack_the_package_end_the_study(tmp_path, monkeypatch):
    def lacking(*_):
        raise ModuleNotFoundError("No module named 'equipoise'")

    monkeypatch.setattr(runner, "run_trial", lacking)
    with pytest.raises(EquipoiseError, match="lack a package: No module named 'equipoise'"):
        study_rows(STATIC, 9, tmp_path / "study", Inline())
    assert rows_in(tmp_path / "study") == []


def test_an_error_of_the_executor_is_a_row(tmp_path, monkeypatch):
    def killed(*_):
        raise RuntimeError("KilledWorker")

    monkeypatch.setattr(runner, "run_trial", killed)
    rows = study_rows(STATIC, 1, tmp_path / "study", Inline())
    assert [(row["status"], row["message"]) for row in rows] == [(LOST, "RuntimeError('KilledWorker')")]


def test_a_script_without_a_main_guard_raises_an_error_that_names_it(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "from equipoise.lab.static.method import Static\n"
        "from equipoise.lab.study.runner import run_study\nfrom equipoise.lab.study.study import Study\n"
        f"run_study(Study(methods=(Static(),)), 2, {str(tmp_path / 'study')!r}, workers=1)\n",
        encoding="utf-8",
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "EquipoiseError: worker processes die at their start" in done.stderr
    assert 'if __name__ == "__main__"' in done.stderr.splitlines()[-1]
    assert rows_in(tmp_path / "study") == []


def test_a_full_disk_ends_the_study(cheap, tmp_path, monkeypatch):
    def full(self):
        raise OutputError("cannot write: no space left")

    monkeypatch.setattr(runner.TrialStore, "flush", full)
    with pytest.raises(OutputError, match="no space left"):
        study_rows(STATIC, 3, tmp_path / "study", workers=1)
    assert not multiprocessing.active_children()


# --- the whole command is killed or interrupted


@POSIX
def test_a_killed_study_loses_seconds_and_can_be_resumed(reference, tmp_path):
    folder = tmp_path / "study"
    process = start_study(folder, "--trials", 1000, "--workers", 1, setup="store._FLUSH_INTERVAL = 0.3")
    wait_for(process, "[3/")
    assert eventually(lambda: len(list((folder / "trials").glob("*.parquet"))) > 0)
    process.kill()
    process.communicate()
    assert eventually(lambda: not alive(process.pid)), "workers outlive the process that started them"
    kept = numbers(rows_in(folder))
    assert len(kept) > 0
    rows = study_rows(STATIC, len(kept) + 1, folder, Inline())
    assert numbers(rows) == list(range(len(kept) + 1))
    count = min(len(rows), 6)
    assert [row["estimated_com_x"] for row in rows[:count]] == [row["estimated_com_x"] for row in reference[:count]]


@POSIX
@pytest.mark.parametrize(
    ("times", "kill", "kept"),
    [(1, os.killpg, 4), (2, os.killpg, 0), (1, os.kill, 4)],  # the second one may interrupt the writing of rows
    ids=["once", "twice", "parent alone"],
)
def test_ctrl_c_ends_a_study_at_once_and_keeps_its_rows(times, kill, kept, tmp_path):
    process = start_study(tmp_path / "study", "--trials", 1000, "--workers", 2, setup="store._FLUSH_INTERVAL = 1e9")
    wait_for(process, "[4/")
    for _ in range(times):
        kill(process.pid, signal.SIGINT)
        time.sleep(0.05)
    output, rest = process.communicate(timeout=60)
    assert process.returncode == 130
    lines = [line for line in rest.splitlines() if not line.startswith("[")]
    assert lines == ["interrupted"]
    assert output == ""
    assert len(rows_in(tmp_path / "study")) >= kept
    assert eventually(lambda: not alive(process.pid))


@POSIX
def test_ctrl_c_while_workers_start_prints_no_traceback(tmp_path):
    process = start_study(tmp_path / "study", "--trials", 1000, "--workers", 2)
    assert eventually(lambda: len(alive(process.pid)) >= 3)  # the command, Python's resource tracker, a worker
    time.sleep(0.1)  # now the worker imports
    os.killpg(process.pid, signal.SIGINT)
    output, rest = process.communicate(timeout=20)
    assert process.returncode == 130
    assert "Traceback" not in rest
    assert output == ""
