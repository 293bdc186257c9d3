"""Helpers for tests of Monte Carlo studies: fast trials, an inline executor, and processes to kill."""

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, Future
from pathlib import Path

from equipoise.lab.static.method import Static
from equipoise.lab.study.rows import table_of
from equipoise.lab.study.runner import run_study
from equipoise.lab.study.store import read_rows
from equipoise.lab.study.study import Study
from equipoise.lab.study.trial import run_trial

STATIC = Study(methods=(Static(),), seed=11)  # 0.1 s a trial
TIMES = ("wall_time", "cpu_time", "estimation_time", "worker")
HERE = Path(__file__).parent


def facts(rows):
    """Return rows without columns that depend on the machine."""
    return [{name: value for name, value in row.items() if name not in TIMES} for row in rows]


def trial_rows(study, trial, logs=None):
    """Return the rows of `run_trial` as dictionaries."""
    return run_trial(study, trial, logs).to_pylist()


def study_rows(*arguments, **options):
    """Return the rows of `run_study` as dictionaries."""
    return run_study(*arguments, **options).to_pylist()


def rows_in(folder):
    """Return the rows of a folder as dictionaries."""
    return read_rows(folder).to_pylist()


class Inline(Executor):
    """Executor that runs calls immediately in this process."""

    def submit(self, function, /, *arguments, **others):
        future = Future()
        try:
            future.set_result(function(*arguments, **others))
        except Exception as error:
            future.set_exception(error)
        return future


def cheap_trial(study, trial, logs=None):
    """Run a trial without a robot. Environment variables make it hang or kill its process, always or the first time."""
    if str(trial) == os.environ.get("HANGING_TRIAL"):
        time.sleep(60)
    if str(trial) == os.environ.get("LETHAL_TRIAL"):
        once = os.environ.get("LETHAL_ONCE")
        if once is None or not Path(once).exists():
            if once is not None:
                Path(once).touch()
            os.kill(os.getpid(), signal.SIGKILL)
    about = {"trial": trial, "status": "ok", "message": "", "worker": os.getpid()}
    return table_of([{**about, "method": used.name} for used in study.methods])


def start_study(folder, *flags, setup="pass"):
    """Start `equipoise lab monte-carlo` in its own session, with progress on stderr after every trial."""
    code = (
        "import sys; from equipoise.__main__ import run; import equipoise.lab.study.store as store; "
        f"import equipoise.lab.terminal as terminal; terminal._PLAIN_INTERVAL = 0; {setup}; sys.exit(run())"
    )
    return subprocess.Popen(
        [sys.executable, "-c", code, "lab", "monte-carlo", "--methods", "static", "--seed", "11", "--no-report",
         "--out", str(folder), *map(str, flags)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip


def wait_for(process, start):
    """Read a process's stderr until a line begins with a text; return the lines."""
    lines = []
    for line in process.stderr:
        lines.append(line)
        if line.startswith(start):
            return lines
    raise AssertionError(f"no line begins with {start!r}: {''.join(lines)}")


def alive(session):
    """Return the running processes of a session, without zombies."""
    running = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, _, owner = path.read_text(encoding="utf-8").rpartition(")")[2].split()[:4]
        except (OSError, ValueError):
            continue
        if int(owner) == session and state not in "ZX":
            running.append(int(path.parent.name))
    return running


def eventually(condition, seconds=20):
    """Return true if a condition becomes true in time."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.05)
    return False
