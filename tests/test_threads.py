"""One thread of linear algebra in the command; programs that import the package choose their own number."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from equipoise.threads import ONE_THREAD, default_threads

ASKED = (
    "import os, sys; before = dict(os.environ); sys.argv[1:] = ['--version']; {}\n"
    "print({{k: v for k, v in os.environ.items() if before.get(k) != v}}, 'numpy' in sys.modules)"
)
BY_COMMAND = "from equipoise.__main__ import run; run()"
BY_IMPORT = "import equipoise; from equipoise.cli import main; main()"


def changed(code, **variables):
    """Return the changes of the environment by a code, and whether NumPy was imported before them."""
    environment = {key: value for key, value in os.environ.items() if key not in ONE_THREAD}
    done = subprocess.run(
        [sys.executable, "-c", ASKED.format(code)],
        env={**environment, **variables},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.splitlines()[-1]


def test_the_command_takes_one_thread_before_numpy_is_imported():
    assert changed(BY_COMMAND) == f"{ONE_THREAD} False"


@pytest.mark.parametrize("variable", ONE_THREAD)
def test_a_number_of_threads_set_by_the_user_is_kept(variable):
    assert default_threads({variable: "4"}) == {}


def test_importing_changes_nothing():
    assert changed(BY_IMPORT) == "{} False"


def test_both_commands_begin_there():
    project = (Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8")
    assert '[project.scripts]\nequipoise = "equipoise.__main__:run"\n' in project
