"""Commands and snippets of every page are accepted, run, and print the output of the page; pages stay short."""

import functools
import io
import os
import re
import runpy
import shutil
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import documents
import mujoco
import numpy as np
import pytest
from documents import PAGES, ROOT, assert_shown, blocks, commands

from equipoise import BayesianMethod, RobotDescription, calibrate, cli, load_robot
from equipoise.cli import arguments, parsing
from equipoise.errors import MissingDependencyError
from equipoise.logs.joint_names import read_joint_map
from equipoise.logs.tables.column_names import Columns
from equipoise.robot.catalog import CATALOG

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

# Pages whose commands need no robot, no network and little time: they are run, on the runs that RUNS makes.
RUN_PAGES = (
    "docs/get-started.md", "docs/your-robot.md", "docs/how-it-works/", "docs/uncertainty-and-checks.md", "docs/comparison.md",
    "docs/motors-and-joint-offsets.md", "docs/reference/robot-config.md", "docs/reference/python-api.md",
)  # fmt: skip
SECONDS = ("audit", "plan", "robots", "platforms", "estimate", "compare")
RUNS = {
    "bare": "calibrate --seed 3 --duration 50s --quiet --no-report --mass 12.44",
    "loaded": "calibrate --seed 3 --duration 50s --payload 1,0.05,0.02,0.08 --quiet --no-report --mass 13.44",
}
"""Commands that make the runs of the pages, by the run's name."""
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]


def label(command):
    return f"{command[0]}: {' '.join(command[1])}"


@pytest.mark.parametrize("command", commands("equipoise"), ids=label)
def test_the_command_line_takes_every_command(command, monkeypatch, capsys):
    find_verb = cli.find_verb
    monkeypatch.setattr(cli, "find_verb", lambda *named: parsed_only(find_verb(*named)))
    monkeypatch.setattr(parsing, "call", lambda *_: None)  # files that the settings name are not there
    monkeypatch.setattr(arguments, "refuse_missing", lambda *_: None)  # neither are robots and runs
    assert cli.main(command[1]) == 0, capsys.readouterr().err


def parsed_only(verb):
    """Replace the verb's action, so that only its flags are parsed."""

    @functools.wraps(verb)
    def parsed(*_, **__):
        return None

    return parsed


@pytest.mark.parametrize("command", commands("make"), ids=label)
def test_make_has_every_target(command):
    for target in (word for word in command[1] if "=" not in word):
        assert re.search(rf"^([\w-]+ )*{target}( [\w-]+)*:", MAKEFILE, re.MULTILINE), target


@pytest.mark.parametrize("command", commands("pip"), ids=label)
def test_every_extra_exists(command):
    for word in command[1]:
        if match := re.fullmatch(r"(?:equipoise|\.)\[(.+)\]", word):
            assert set(match[1].split(",")) <= set(EXTRAS)


@pytest.mark.parametrize("command", commands("python"), ids=label)
def test_python_finds_every_program(command):
    kind, *rest = command[1]
    if kind != "-m":
        assert (ROOT / kind).is_file()
    else:
        assert rest[0] in ("venv", "pip")


def test_verbs_in_the_text_exist():
    verbs = {*cli.VERBS, *cli.GROUPS, "--help", "--version"}
    for page in PAGES:
        for verb in re.findall(r"`equipoise ([\w-]+)[^`]*`", page.read_text(encoding="utf-8")):
            assert verb in verbs, f"{page.name}: equipoise {verb}"


@pytest.fixture(scope="session")
def workspace(tmp_path_factory, a1_urdf):
    """Return a folder in which the pages' commands can be run: two short runs, a robot and its configuration."""
    folder = tmp_path_factory.mktemp("documents")
    (folder / "my_robot.urdf").write_text(a1_urdf, encoding="utf-8")
    (folder / "my_robot.toml").write_text(first_toml(ROOT / "docs" / "reference" / "robot-config.md"), encoding="utf-8")
    for name, command in RUNS.items():
        assert run_in(folder, *command.split(), "--out", f"runs/{name}")[0] == 0
    for name in ("first", "a1"):  # as other pages call it
        shutil.copytree(folder / "runs" / "loaded", folder / "runs" / name)
    return folder


def first_toml(page):
    return next(block.code for block in blocks(page) if block.language == "toml")


def run_in(folder, *arguments):
    """Return exit code and printed text."""
    before, printed = Path.cwd(), io.StringIO()
    os.chdir(folder)
    try:
        with redirect_stdout(printed), redirect_stderr(printed):
            return cli.main(arguments), printed.getvalue()
    finally:
        os.chdir(before)


def skip_without(robots):
    """Skip the test if the package of one of these robots is not installed."""
    try:
        for robot in robots:
            CATALOG[robot].find()
    except MissingDependencyError as error:
        pytest.skip(str(error))


def runs_here(command):
    page, arguments, _ = command
    mine = page.startswith(RUN_PAGES) and "--platform" not in arguments
    return mine and (arguments[0] in SECONDS or "--dry-run" in arguments)


@pytest.mark.parametrize("command", [c for c in commands("equipoise") if runs_here(c)], ids=label)
def test_commands_that_take_seconds_work(command, workspace):
    skip_without(CATALOG.keys() & set(command[1]))
    code, printed = run_in(workspace, *command[1])
    assert code == 0, printed


def python_blocks():
    pages = [page for page in PAGES if page.name != "CONTRIBUTING.md"]
    code = [block for page in pages for block in blocks(page) if block.language == "python"]
    return [block for block in code if "import" in block.code]  # others are pieces of files that people have


@pytest.mark.parametrize("block", python_blocks(), ids=lambda block: block.page)
def test_python_on_the_pages_runs(block, workspace, monkeypatch):
    monkeypatch.chdir(workspace)
    if "go2" in block.code:
        pytest.importorskip("pyarrow")
        skip_without({"go2"})
    printed = io.StringIO()
    with redirect_stdout(printed):
        exec(compile(block.code, block.page, "exec"), {"__name__": "page"})
    if block.shown is not None:
        assert_shown(printed.getvalue(), block.shown, abs=0.6, rel=0.1)


def test_the_class_of_your_robot_calibrates_a_robot_in_its_mujoco_scene(tmp_path):
    robot = load_robot("unitree_a1")
    spec = mujoco.MjSpec.from_string(robot.source.xml)
    spec.worldbody.first_body().add_freejoint()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
    for joint in spec.joints[1:]:
        joint.armature, joint.frictionloss = 0.01, 0.2
    spec.body("trunk").add_site(name="imu")
    for name, kind in (
        ("gyro", mujoco.mjtSensor.mjSENS_GYRO),
        ("accelerometer", mujoco.mjtSensor.mjSENS_ACCELEROMETER),
    ):
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="imu")
    spec.compile()
    (tmp_path / "scene.xml").write_text(spec.to_xml(), encoding="utf-8")
    page = ROOT / "docs" / "your-robot.md"
    (block,) = (block for block in blocks(page) if "class MyRobot" in block.code)
    names = {"__name__": "my_module"}
    exec(compile(block.code, page.name, "exec"), names)
    with names["MyRobot"](robot, scene=str(tmp_path / "scene.xml")) as platform:
        result = calibrate(platform, robot, BayesianMethod(60.0, mass=platform.model.body_mass.sum()))
    assert [check.name for check in result.checks if not check.passed] == []
    com = [quantity.value for quantity in result.composite.com_in_base]
    np.testing.assert_allclose(com, result.nominal.composite.com, atol=2e-3)


@pytest.mark.parametrize("command", [c for c in commands("python") if c[1][0].startswith("examples/")], ids=label)
def test_examples_run_and_print_the_output_that_a_page_shows(command, workspace, monkeypatch):
    _, (script, *arguments), shown = command
    monkeypatch.chdir(workspace)
    monkeypatch.setattr(sys, "argv", [script, *arguments])
    printed = io.StringIO()
    with redirect_stdout(printed):
        runpy.run_path(str(ROOT / script), run_name="__main__")
    assert printed.getvalue()
    if shown is not None:
        assert_shown(printed.getvalue(), shown, abs=0.35, rel=0.25)


def test_every_example_is_on_a_page_and_short():
    scripts = sorted((ROOT / "examples").glob("*.py"))
    shown = {command[1][0] for command in commands("python")}
    assert len(scripts) == 7
    for script in scripts:
        assert f"examples/{script.name}" in shown
        assert len(script.read_text(encoding="utf-8").splitlines()) < 40


def test_the_notebook_runs(workspace):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    kernels = pytest.importorskip("jupyter_client.kernelspec")
    if "python3" not in kernels.KernelSpecManager().find_kernel_specs():
        pytest.skip("no Jupyter kernel 'python3' is installed: the notebook is NOT tested (pip install ipykernel)")
    notebook = nbformat.read(ROOT / "examples" / "calibrate.ipynb", as_version=4)
    nbclient.NotebookClient(notebook, timeout=120, resources={"metadata": {"path": workspace}}).execute()
    outputs = [
        o["data"].get("text/html", "") for cell in notebook.cells for o in cell.get("outputs", []) if "data" in o
    ]
    assert sum("<iframe" in output for output in outputs) == 1
    assert not any("outputs" in cell and cell.outputs for cell in nbformat.read(
        ROOT / "examples" / "calibrate.ipynb", as_version=4).cells)  # fmt: skip


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_tables_of_settings_are_toml(page, tmp_path):
    for block in blocks(page):
        if block.language != "toml":
            continue
        table = tomllib.loads(block.code)
        if "units" in table:
            Columns.from_text(block.code, "the page")
        elif page.name == "logs.md":
            (tmp_path / "map.toml").write_text(block.code, encoding="utf-8")
            assert read_joint_map(tmp_path / "map.toml") == table
        else:
            assert RobotDescription.from_dict(table)


def test_pages_that_the_code_names_exist():
    files = [*(ROOT / "src").rglob("*.py"), *(ROOT / "benchmarks").rglob("*.py"), ROOT / "action.yml"]
    for file in files:
        for page in re.findall(r"\bdocs/[\w/-]+\.md", file.read_text(encoding="utf-8")):
            assert (ROOT / page).is_file(), f"{file.relative_to(ROOT)}: {page}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_to_files_of_the_repository(page):
    text = re.sub(r"^```.*?^```|`[^`\n]*`", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    for link in re.findall(r"\]\((?!https?:|#|mailto:)([^)#\s]+)", text):
        assert (page.parent / link).exists(), link


def test_blocks_are_found_with_their_output(tmp_path, monkeypatch):
    page = tmp_path / "page.md"
    page.write_text("words\n\n    make it  # so\n\n```python\nprint(1)\n```\n\n```\n1\n```\n", encoding="utf-8")
    monkeypatch.setattr(documents, "ROOT", tmp_path)
    assert [(b.language, b.code, b.shown) for b in blocks(page)] == [
        ("", "make it  # so\n", None), ("python", "print(1)\n", "1\n"), ("", "1\n", None),
    ]  # fmt: skip
