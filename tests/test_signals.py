"""Tests of Ctrl-C where the parent ignores it, as `make test &` in a script does."""

import os
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_tests_of_signals_pass_where_the_parent_ignores_signals():
    files = ["platform/test_interruptions.py", "recording/test_run_log.py"]
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        *files,
        "-k",
        "SIGINT or SIGHUP or ctrl_c",
    ]
    done = subprocess.run(
        ["sh", "-c", "trap '' INT TERM HUP; exec \"$@\"", "sh", *command],
        cwd=Path(__file__).parent, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    assert " passed" in done.stdout
