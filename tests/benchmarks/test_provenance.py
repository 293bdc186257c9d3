"""Provenance of results pages, and the note on pages whose sources have changed."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / "benchmarks"))  # last: some names equal those of tests
import provenance  # noqa: E402
from provenance import RESULTS, Page, pages  # noqa: E402
from sources import Tree, sources, tree_of  # noqa: E402

PACKAGE = "src/equipoise"
TREE = {
    "benchmarks/toy.py": b'from equipoise import thing\nfrom helper import help_me\nDATA = "rows.csv"\n',
    "benchmarks/helper.py": b"def help_me():\n    import equipoise.late\n",
    "benchmarks/rows.csv": b"1,2",
    "benchmarks/other.py": b"",
    f"{PACKAGE}/__init__.py": b"if TYPE_CHECKING:\n    from equipoise.here import thing\n    from equipoise.there import a\n",
    f"{PACKAGE}/here.py": b'TABLE = {"a": "equipoise.rooms.one:One"}\nimport inspect',
    f"{PACKAGE}/there.py": b"",
    f"{PACKAGE}/late.py": b'RUN = [python, "-m", "equipoise.started"]',
    f"{PACKAGE}/started.py": b"import equipoise.verbs.inspect\n",
    f"{PACKAGE}/inspect.py": b"",
    f"{PACKAGE}/rooms/__init__.py": b"",
    f"{PACKAGE}/rooms/one.py": b'FOLDER = "models"\n',
    f"{PACKAGE}/rooms/two.py": b"",
    f"{PACKAGE}/rooms/models/robot.urdf": b"<robot/>",
    f"{PACKAGE}/verbs/__init__.py": b'def find(name):\n    return import_module(f"equipoise.verbs.{name}")\n',
    f"{PACKAGE}/verbs/inspect.py": b"",
    f"{PACKAGE}/verbs/export.py": b"",
}
USED = {
    "benchmarks/toy.py", "benchmarks/helper.py", "benchmarks/rows.csv", f"{PACKAGE}/__init__.py", f"{PACKAGE}/here.py",
    f"{PACKAGE}/late.py", f"{PACKAGE}/started.py", f"{PACKAGE}/rooms/__init__.py", f"{PACKAGE}/rooms/one.py",
    f"{PACKAGE}/rooms/models/robot.urdf", f"{PACKAGE}/verbs/__init__.py", f"{PACKAGE}/verbs/inspect.py",
}  # fmt: skip


def test_sources_are_imported_started_loaded_by_name_or_read():
    assert {*sources("benchmarks/toy.py", Tree(TREE))} == USED


def test_a_module_that_dispatches_by_name_uses_all_modules():
    tree = Tree({**TREE, "benchmarks/toy.py": b"from equipoise.verbs import find\n"})
    assert f"{PACKAGE}/verbs/export.py" in sources("benchmarks/toy.py", tree)


@pytest.mark.parametrize(
    ("path", "content", "same"),
    [
        ("benchmarks/helper.py", b'def help_me( ):  # help\n\n    """Help."""\n    import equipoise.late', True),
        ("benchmarks/helper.py", b"def help_me(one=1):\n    import equipoise.late\n", False),
        ("benchmarks/rows.csv", b"1,3", False),
        ("benchmarks/other.py", b"1 + 1", True),
    ],
)
def test_code_and_data_count_and_comments_layout_and_docstrings_do_not(path, content, same):
    before, changed = Tree(TREE), Tree({**TREE, path: content})
    assert (sources("benchmarks/toy.py", changed) == sources("benchmarks/toy.py", before)) is same


def test_sources_of_a_real_benchmark_are_its_own():
    found = sources("benchmarks/real_logs.py", tree_of())
    assert {"benchmarks/real_logs.py", f"{PACKAGE}/estimator/problem.py", f"{PACKAGE}/logs/tables/streams.py"} <= {
        *found
    }
    assert f"{PACKAGE}/robot/models/a1.urdf" in found
    others = (f"{PACKAGE}/view", f"{PACKAGE}/report", "benchmarks/baselines")
    assert not [path for path in found if path.startswith(others)]


@pytest.mark.parametrize("path", pages(), ids=lambda path: path.relative_to(RESULTS).as_posix())
def test_every_page_names_its_commits_sources_and_command(path):
    page = Page.read(path)
    assert page.commits
    assert (ROOT / page.maker).is_file()
    assert page.hashes
    assert re.fullmatch(r"make [\w-]+|python benchmarks/[\w/]+\.py", page.command)


@pytest.fixture
def repository(tmp_path):
    """Repository with one benchmark and its current page."""
    for name in ("provenance.py", "sources.py"):
        (tmp_path / "benchmarks" / "results").mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / "benchmarks" / name, tmp_path / "benchmarks")
    (tmp_path / PACKAGE).mkdir(parents=True)
    (tmp_path / PACKAGE / "__init__.py").write_text("NUMBER = 1\n")
    (tmp_path / "Makefile").write_text("bench-toy: all\n\tpython benchmarks/toy.py\n")
    toy = (
        "import sys\nimport equipoise\nfrom provenance import write_page\n"
        "write_page('toy.md', '# Toy\\n', eval(sys.argv[1]))\n"
    )
    (tmp_path / ".gitignore").write_text("__pycache__\n")
    (tmp_path / "benchmarks" / "toy.py").write_text(toy)
    git(tmp_path, "init", "--quiet")
    commit(tmp_path)
    make(tmp_path)
    return tmp_path


def git(folder, *arguments):
    identity = ("-c", "user.name=a", "-c", "user.email=a@b")
    done = subprocess.run(["git", *identity, *arguments], cwd=folder, check=True, capture_output=True, text=True)
    return done.stdout.strip()


def commit(folder):
    git(folder, "add", "--all")
    git(folder, "commit", "--quiet", "--message", "one")
    return git(folder, "rev-parse", "--short", "HEAD")


def make(folder, rows="None"):
    python(folder, "benchmarks/toy.py", rows)
    return (folder / "benchmarks" / "results" / "toy.md").read_text()


def python(folder, *arguments):
    environment = {**os.environ, "PYTHONPATH": "src"}
    done = subprocess.run(
        [sys.executable, *arguments], cwd=folder, check=True, capture_output=True, text=True, env=environment
    )
    return done.stdout.strip()


def status(folder):
    return python(folder, "benchmarks/provenance.py")


def test_a_page_is_current_until_its_sources_change(repository):
    first = git(repository, "rev-parse", "--short", "HEAD")
    assert status(repository) == "toy.md: current"
    package = repository / PACKAGE / "__init__.py"
    package.write_text("NUMBER = 1  # one\n")
    commit(repository)
    assert status(repository) == "toy.md: current"
    package.write_text("NUMBER = 2\n")
    assert status(repository) == (
        f"toy.md: Made by older code: commit {first}; 1 of its 2 source files have changed since; make it again with "
        "`make bench-toy`."
    )


def test_without_history_the_hash_decides(repository):
    first = git(repository, "rev-parse", "--short", "HEAD")
    shutil.rmtree(repository / ".git")
    assert status(repository) == "toy.md: current"
    (repository / PACKAGE / "__init__.py").write_text("NUMBER = 2\n")
    assert status(repository) == f"toy.md: Made by older code: commit {first}; make it again with `make bench-toy`."


def test_a_page_of_rows_names_each_commit_and_is_current_only_if_all_are(repository):
    first = git(repository, "rev-parse", "--short", "HEAD")
    (repository / PACKAGE / "__init__.py").write_text("NUMBER = 2\n")
    second = commit(repository)
    page = make(repository, str([{"commit": first}, {"commit": second}]))
    made = re.search(r"\nMade at commit (\w+), (\w+); sources (\w{12}), (\w{12})\.\n$", page)
    assert {made[1], made[2]} == {first, second}
    assert status(repository).startswith("toy.md: Made by older code")
    make(repository, str([{"commit": second}]))
    assert status(repository) == "toy.md: current"
    assert "sources unknown" in make(repository, "[{}]")


def test_readme_names_the_commit_of_figures_and_marks_older_code():
    paragraphs = (ROOT / "README.md").read_text(encoding="utf-8").split("\n\n")
    quoting = [text for text in paragraphs if "](benchmarks/results/" in text]
    assert quoting
    assert not [text for text in paragraphs if "RMSE" in text and text not in quoting]
    for text in quoting:
        for link in re.findall(r"\]\((benchmarks/results/[^)#]+\.md)", text):
            page = Page.read(ROOT / link)
            assert all(name in text for name in page.commits)
            assert ("older code" in " ".join(text.split())) is not page.is_current


def test_a_page_of_older_code_is_current_if_repeated_rows_were_equal(tmp_path, monkeypatch):
    monkeypatch.setattr(provenance, "RESULTS", tmp_path)
    page = tmp_path / "robots.md"
    page.write_text("# Robots\n\nMade at commit 0123abc; sources another.\n", encoding="utf-8")
    assert not Page.read(page).is_current
    provenance.confirm_page("robots.md", 3)
    provenance.confirm_page("robots.md", 5)
    assert Page.read(page).is_current
    text = page.read_text(encoding="utf-8")
    assert text.count("Repeated at commit") == 1
    assert ": 5 rows, equal; sources " in text
    page.write_text(text.replace(provenance.hash_of("benchmarks/robots.py"), "changed"), encoding="utf-8")
    assert not Page.read(page).is_current
