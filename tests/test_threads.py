"""The command takes one thread for linear algebra; who imports the package decides for himself."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from equipoise.threads import ONE_THREAD, unless_told

ASKED = (
    "import os, sys; before = dict(os.environ); sys.argv[1:] = ['--version']; {}\n"
    "print({{k: v for k, v in os.environ.items() if before.get(k) != v}}, 'numpy' in sys.modules)"
)
BY_COMMAND = "from equipoise.__main__ import run; run()"
BY_IMPORT = "import equipoise; from equipoise.cli import main; main()"


def changed(how, **told):
    """What a way of use changes in the environment, and whether NumPy was there before it could read that."""
    environment = {key: value for key, value in os.environ.items() if key not in ONE_THREAD}
    done = subprocess.run(
        [sys.executable, "-c", ASKED.format(how)],
        env={**environment, **told},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.splitlines()[-1]


def test_the_command_takes_one_thread_before_numpy_is_imported():
    assert changed(BY_COMMAND) == f"{ONE_THREAD} False"


@pytest.mark.parametrize("variable", ONE_THREAD)
def test_who_says_how_many_gets_them(variable):
    assert unless_told({variable: "4"}) == {}


def test_importing_changes_nothing():
    assert changed(BY_IMPORT) == "{} False"


def test_both_commands_begin_there():
    project = (Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8")
    assert '[project.scripts]\nequipoise = "equipoise.__main__:run"\n' in project
