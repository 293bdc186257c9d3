"""What tests of Monte Carlo studies share: cheap trials, an executor that is none, and processes that are killed."""

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
    """Rows without what depends on the machine."""
    return [{name: value for name, value in row.items() if name not in TIMES} for row in rows]


def trial_rows(study, trial, logs=None):
    """`run_trial`, its rows as dictionaries."""
    return run_trial(study, trial, logs).to_pylist()


def study_rows(*arguments, **options):
    """`run_study`, its rows as dictionaries."""
    return run_study(*arguments, **options).to_pylist()


def rows_in(folder):
    """`read_rows`, as dictionaries."""
    return read_rows(folder).to_pylist()


class Inline(Executor):
    """Runs what it is given at once, in this process."""

    def submit(self, function, /, *arguments, **others):
        future = Future()
        try:
            future.set_result(function(*arguments, **others))
        except Exception as error:
            future.set_exception(error)
        return future


def cheap_trial(study, trial, logs=None):
    """A trial without a robot. It kills its process where the environment tells it to: always, or the first time; or hangs."""
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
    """`equipoise lab monte-carlo` in a session of its own, its progress on stderr after every trial."""
    code = (
        "import sys; from equipoise.__main__ import run; import equipoise.lab.study.store as store; "
        f"import equipoise.lab.terminal as terminal; terminal._PLAIN_INTERVAL = 0; {setup}; sys.exit(run())"
    )
    return subprocess.Popen(
        [sys.executable, "-c", code, "lab", "monte-carlo", "--methods", "static", "--seed", "11", "--no-report",
         "--out", str(folder), *map(str, flags)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip


def wait_for(process, words):
    """Read a process's stderr until a line begins so; what was read."""
    seen = []
    for line in process.stderr:
        seen.append(line)
        if line.startswith(words):
            return seen
    raise AssertionError(f"{words!r} was never said: {''.join(seen)}")


def alive(session):
    """Processes of a session that run (a zombie does not)."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, _, owner = path.read_text(encoding="utf-8").rpartition(")")[2].split()[:4]
        except (OSError, ValueError):
            continue
        if int(owner) == session and state not in "ZX":
            found.append(int(path.parent.name))
    return found


def eventually(condition, seconds=20):
    """Whether something becomes so."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.05)
    return False
