"""Commands and statements of the README."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from documents import WEIGHED, assert_shown, blocks

from equipoise import errors
from equipoise.cli import INTERRUPTED
from equipoise.errors import MissingDependencyError, SettingsError
from equipoise.result.requirements import UNMET
from equipoise.robot.catalog import BUILT_IN_ROBOT, CATALOG

README = Path(__file__).parents[1] / "README.md"
MAKEFILE = README.with_name("Makefile")


README_COMMANDS = [
    line.partition(" #")[0].strip()
    for block in blocks(README)
    for line in block.code.splitlines()
    if re.match(r"(make|pip|python|equipoise|\.|git|cd) ", line)
]
PACKAGES = {"example-robot-data": "robots"}  # extra that brings a package of robots
# No test looks for a robot in the network of the machine that it runs on: here the commands' way ends, at the interface.
HARDWARE = ("interface=eth0", "interface=nowhere0")
# A run whose output the README does not show is a short one.
SHORTER = ("calibrate go2 --payload", "calibrate go2 --duration 45s --payload")


@pytest.fixture(scope="module")
def text():
    return README.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """Run the README's commands in order in a new folder; return (command, exit code, output) of each."""
    folder = tmp_path_factory.mktemp("clone")
    typed = [command for command in README_COMMANDS if command.startswith("equipoise ")]
    return folder, [
        (command, *run(command.replace(*HARDWARE).replace(*WEIGHED).replace(*SHORTER), folder)) for command in typed
    ]


def run(command, folder):
    """Return the exit code, and the text on stdout and stderr."""
    program, *words = shlex.split(command)
    assert program == "equipoise"
    done = subprocess.run(
        [sys.executable, "-m", program, *words], cwd=folder, capture_output=True, text=True, check=False,
        env={**os.environ, "COLUMNS": "80", "PYTHONPATH": os.pathsep.join(sys.path)}, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    return done.returncode, done.stdout, done.stderr


def test_every_command_works_in_the_order_of_the_readme(ran):
    folder, done = ran
    assert len(done) >= 5
    for command, code, out, err in done:
        if lacks_robot(command):  # which the README installs, and this environment may not have
            assert code == MissingDependencyError.exit_code, (command, out, err)
            assert "pip install 'equipoise[robots]'" in err, command
        elif "interface=eth0" in command:
            assert code == SettingsError.exit_code, (command, out, err)
            assert "network interface 'nowhere0' does not exist" in err, command
        else:
            assert code == 0, (command, out, err)
    assert (folder / "runs/first/report.html").exists()


def lacks_robot(command):
    """Return whether a robot of a command needs a package that is not installed."""
    return any(CATALOG[word].install for word in command.split() if word in CATALOG)


def test_all_commands_were_tried(ran):
    if untried := [command for command, *_ in ran[1] if lacks_robot(command)]:
        pytest.skip(f"example-robot-data is not installed: {len(untried)} commands of the README are NOT TRIED")


def test_packages_of_a_command_are_installed_before_it():
    extras = set(re.search(r"(?<=run:)\w+", MAKEFILE.read_text(encoding="utf-8"))[0].split(","))
    assert README_COMMANDS[0] == "make install"
    for command in README_COMMANDS:
        words = shlex.split(command)
        if words[0] == "pip":
            extras |= {
                extra for word in words for extra in re.findall(r"\[(.*)\]", word)[:1] for extra in extra.split(",")
            }
        needed = {PACKAGES[CATALOG[word].source] for word in words if word in CATALOG and word != BUILT_IN_ROBOT}
        needed |= {"dds"} if "unitree-go2" in words else {"desk"} if "calibrate" in words else set()
        assert needed <= extras, command


def outside_make():
    """Return the environment without the variables that `make test` sets for make itself."""
    return {
        name: value for name, value in os.environ.items() if name not in ("VENV", "MAKEFLAGS", "MFLAGS", "MAKELEVEL")
    }


@pytest.mark.parametrize("target", [command.split()[1] for command in README_COMMANDS if command.startswith("make ")])
def test_make_has_a_recipe(target, tmp_path):
    done = subprocess.run(
        ["make", "--dry-run", "-C", README.parent, target],
        capture_output=True,
        text=True,
        check=False,
        env=outside_make(),
    )
    assert done.returncode == 0, done.stderr
    if target == "install":
        assert ". .venv/bin/activate" in README_COMMANDS
        assert "'. .venv/bin/activate'" in done.stdout


@pytest.mark.parametrize(("before", "out"), [([], "runs/first"), (["first"], "runs/demo-$(date +%Y%m%d-%H%M%S)")])
def test_a_demo_makes_the_run_of_the_readme_and_replaces_none(before, out, tmp_path, text):
    shutil.copy(MAKEFILE, tmp_path)
    for name in before:
        (tmp_path / "runs" / name).mkdir(parents=True)
    done = subprocess.run(
        ["make", "-n", "-o", ".venv/.run-installed", "demo"],
        cwd=tmp_path, capture_output=True, text=True, check=True, env=outside_make(),
    )  # fmt: skip
    recipe = " ".join(done.stdout.replace("\\\n", " ").split())
    (command,) = re.findall(r"^    equipoise (calibrate --payload \S+ --seed.*) --out runs/first$", text, re.MULTILINE)
    assert f".venv/bin/equipoise {command} --out {out} echo" in recipe


def test_the_first_command_prints_what_the_readme_shows(text, ran):
    """Other engine versions may differ: by half a millimetre, or a tenth of a moment."""
    folder, done = ran
    _, _, printed, _ = done[0]
    shown = re.search(r"```\n(unitree_a1: method bayesian.*?)```", text, re.DOTALL).group(1)
    assert_shown(plain(printed.partition("saved:")[0]), plain(shown), abs=0.6, rel=0.1)
    (shown,) = re.findall(r"```\n(warning: .*?)```", text, re.DOTALL)
    ((_, _, out, err),) = [each for each in done if each[0].startswith("equipoise export")]
    assert_shown((err + out).replace(f"{folder.resolve()}/", ""), shown, abs=0, rel=0)


def plain(shown):
    """Return the text without blank lines and ends of lines."""
    return "\n".join(line.rstrip() for line in shown.splitlines() if line.strip())


def test_the_readme_is_a_screen_and_a_half(text):
    assert len(text.splitlines()) < 100


def test_exit_codes_without_an_exception_are_documented():
    text = " ".join((README.parent / "docs" / "reference" / "cli.md").read_text(encoding="utf-8").split())
    (sentence,) = re.findall(r"Also: (.*?)\. ", text)
    listed = {int(part.split()[0]) for part in sentence.split("; ")}
    raised = {
        error.exit_code for error in vars(errors).values() if isinstance(error, type) and "exit_code" in vars(error)
    }
    assert listed == {
        0,
        1,
        9,
        UNMET,
        errors.UNHEALTHY,
        errors.STOP_REQUESTED,
        INTERRUPTED,
    }  # 9: workers, which have no class of their own
    assert listed & raised == {1}


def test_make_has_the_targets_that_documents_name():
    pages = (README, README.with_name("CONTRIBUTING.md"), *README.with_name("docs").rglob("*.md"))
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages)
    named = {*re.findall(r"(?:^ *|`)make ([a-z][\w-]*)", text, re.MULTILINE)}
    assert {"test", "bench", "bench-accuracy"} <= named
    subprocess.run(["make", "--dry-run", *sorted(named)], cwd=README.parent, check=True, capture_output=True)


def test_files_that_the_readme_links_to_exist(text):
    for link in re.findall(r"\]\((?!http)([^)#]+)\)", text):
        assert (README.parent / link).exists(), link
