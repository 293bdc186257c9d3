"""Tests marked `realtime` are repeated if the machine stalled, and only then."""

import os
import sys

import pytest

from equipoise.guard.remote_robot import RemoteRobot

pytest_plugins = "pytester"

MODULE = """
import os, pathlib, signal, time
import pytest
from real_time import watcher

@pytest.fixture(scope="module")
def tries():
    with pathlib.Path("tries").open("a") as tries:
        tries.write("x")
    return pathlib.Path("tries").read_text()

@pytest.mark.realtime
def test_it(tries):
    if {stall}:
        watcher().wait_for("ready")
        os.kill(watcher()._process.pid, signal.SIGSTOP)
        time.sleep(0.2)
        os.kill(watcher()._process.pid, signal.SIGCONT)
    assert len(tries) == {passing_try}
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="signals stop no process here")
@pytest.mark.parametrize(
    ("stall", "passing_try", "tries", "outcome"),
    [
        (False, 1, 1, {"passed": 1}),
        (True, 2, 2, {"passed": 1}),
        (True, 9, 3, {"skipped": 1}),
        (False, 2, 1, {"failed": 1}),
    ],
)
def test_a_failure_is_repeated_only_in_a_stall(pytester, monkeypatch, stall, passing_try, tries, outcome):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    pytester.makeini("[pytest]\nmarkers = realtime: in real time")
    limit = "" if stall else "real_time.STALL = 1e3"  # [s] so that a stall of this machine does not count
    pytester.makeconftest(f"import real_time\nfrom real_time import pytest_runtest_protocol\n{limit}\n")
    pytester.makepyfile(MODULE.format(stall=stall, passing_try=passing_try))
    result = pytester.runpytest_subprocess("-rs")
    result.assert_outcomes(**outcome)
    assert (pytester.path / "tries").read_text() == tries * "x"
    if "skipped" in outcome:
        busy = "*this machine is too busy for real time: 3 tries failed, with stalls of 0.*; "
        result.stdout.fnmatch_lines([busy + "NOT TRIED, or wrong: AssertionError: assert 3 == 9*"])


def test_a_robot_process_needs_the_mark(a1):
    with pytest.raises(
        pytest.fail.Exception, match=r"needs_the_mark starts a robot process; mark it with pytest\.mark"
    ):
        RemoteRobot("unitree-go2", a1, {})
