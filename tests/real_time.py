"""Repeat tests marked `realtime` that fail while this machine, and not the code under test, falls behind real time."""

import functools
import time
from contextlib import suppress

from _pytest.runner import runtestprotocol
from emulator_processes import EmulatorProcess

STALL = 0.02  # [s] delay of a process without priority that a machine which keeps up does not cause
TRIES = 3

# A process of its own: the code under test delays it only if it occupies the processor. It sleeps like a control loop and
# computes for 5 ms at intervals, because a scheduler prefers a process that only sleeps.
_WATCHER = """
import json, os, sys, time
stall, parent = float(sys.argv[1]), os.getppid()
print(json.dumps({"ready": True}), flush=True)
while os.getppid() == parent:
    for work in [*[0.0] * 50, 5e-3]:
        begun, worked = time.monotonic(), time.process_time()
        time.sleep(2e-3)
        while time.process_time() - worked < work:
            pass
        now = time.monotonic()
        late = now - begun - 2e-3 - work
        if late > stall:
            print(json.dumps({"until": now, "late": late}), flush=True)
"""


@functools.cache
def watcher():
    """Start the process that records stalls of this machine; it ends with the process of the tests."""
    return EmulatorProcess(None, STALL, code=_WATCHER)


def longest_stall(since):
    """Return the longest delay of the watcher after a moment of the monotonic clock [s]; 0 if the machine kept up."""
    time.sleep(0.1)  # for a stall that has not ended
    return max((entry["late"] for entry in watcher().log if entry.get("until", since) > since), default=0.0)


def pytest_runtest_protocol(item, nextitem):
    """Run a test marked `realtime`; leave all others to pytest."""
    if item.get_closest_marker("realtime") is None:
        return None
    watcher()
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    for report in reports_of_last_try(item, nextitem):
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


def reports_of_last_try(item, nextitem):
    """Run a test until it passes, fails without a stall, or has failed in as many stalls as there are tries."""
    stalls = []
    while True:
        begun = time.monotonic()
        reports = runtestprotocol(item, log=False, nextitem=nextitem)
        failed = [report for report in reports if report.failed]
        stall = longest_stall(begun) if failed else 0.0
        if stall:
            stalls.append(f"{stall:.3f} s")
        if not stall or len(stalls) == TRIES:
            break
        with suppress(Exception):  # from fixtures of the failed try; the next one makes all of them again
            item.session._setupstate.teardown_exact(None)
    if len(stalls) == TRIES:
        skip(
            failed,
            item,
            f"this machine is too busy for real time: {TRIES} tries failed, with stalls of {', '.join(stalls)}; "
            f"NOT TRIED, or wrong: {last_line(failed[0])}",
        )
    reports[-1].user_properties.append(("stalls", stalls))
    return reports


def last_line(report):
    """Return the line in which a test failed, with the values: an error of the code is the same on every machine."""
    crash = getattr(report.longrepr, "reprcrash", None)
    return (str(report.longrepr) if crash is None else crash.message).partition("\n")[0]


def skip(reports, item, reason):
    """Turn reports of failures into those of a test that was skipped."""
    path, line, _ = item.location
    for report in reports:
        report.outcome, report.longrepr = "skipped", (path, line, f"Skipped: {reason}")


def repeated(terminalreporter):
    """Return the names of tests that were tried again, or skipped, because of stalls."""
    return [report.nodeid for report in terminalreporter.getreports("") if dict(report.user_properties).get("stalls")]
