"""`audit` in other repositories: annotations, pre-commit hook and GitHub action."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from equipoise.cli import main

HERE = Path(__file__).parents[2]
PROGRAM = Path(sys.executable).parent / "equipoise"
HOOKS = HERE / ".pre-commit-hooks.yaml"


@pytest.fixture
def repository(tmp_path, a1_urdf):
    """Repository with one invalid and one valid robot."""
    folder = tmp_path / "theirs"
    (folder / "urdf").mkdir(parents=True)
    (folder / "urdf" / "well.urdf").write_text(a1_urdf, encoding="utf-8")
    (folder / "urdf" / "bad.urdf").write_text(flattened(a1_urdf), encoding="utf-8")
    return folder


def flattened(urdf):
    """Return the URDF with an impossible trunk inertia."""
    before, trunk = urdf.split('<link name="trunk">')
    return before + '<link name="trunk">' + trunk.replace('ixx="', 'ixx="9', 1)


def test_findings_are_annotations_at_their_links(repository, monkeypatch, capsys):
    monkeypatch.chdir(repository)
    assert main(["audit", "--format", "github", "urdf/bad.urdf", "urdf/none.urdf", "urdf/well.urdf"]) == 3
    out = capsys.readouterr().out
    text = (repository / "urdf" / "bad.urdf").read_text(encoding="utf-8")
    line = text.split('<link name="trunk">')[0].count("\n") + 1
    errors = [row for row in out.splitlines() if row.startswith("::error ")]
    assert errors[0].startswith(f"::error file=urdf/bad.urdf,line={line},title=equipoise audit%3A trunk::")
    assert errors[1].startswith(
        "::error file=urdf/none.urdf,line=1,title=equipoise audit::robot model 'urdf/none.urdf'"
    )
    assert not any("well.urdf" in row for row in errors)
    assert main(["audit", "--format", "github", "urdf/bad.urdf"]) == 1
    assert main(["audit", "--format", "github", "urdf/well.urdf"]) == 0
    assert main(["audit"]) == 2
    assert "name a robot, or a URDF or MJCF file" in capsys.readouterr().err


def test_a_name_cannot_end_an_annotation(repository, monkeypatch, capsys):
    monkeypatch.chdir(repository)
    bad = repository / "urdf" / "a,b:c%\n::stop.urdf"
    bad.write_text("<robot", encoding="utf-8")
    assert main(["audit", "--format", "github", str(bad.relative_to(repository))]) == 3
    out = capsys.readouterr().out
    assert out.startswith("::error file=urdf/a%2Cb%3Ac%25%0A%3A%3Astop.urdf,line=1,title=equipoise audit::")
    assert out.count("\n") == 1


@pytest.mark.skipif(not PROGRAM.exists(), reason="equipoise is not installed as a program")
def test_the_actions_script_takes_patterns_and_flags(repository, tmp_path):
    yaml = pytest.importorskip("yaml")
    script = yaml.safe_load((HERE / "action.yml").read_text(encoding="utf-8"))["runs"]["steps"][1]["run"]
    place = tmp_path / "equipoise" / "bin"
    place.mkdir(parents=True)
    (place / "equipoise").symlink_to(PROGRAM)

    def run(files, arguments=""):
        env = {**os.environ, "FILES": files, "ARGUMENTS": arguments, "RUNNER_TEMP": str(tmp_path)}
        return subprocess.run(
            ["bash", "-e", "-c", script], cwd=repository, env=env, capture_output=True, text=True, check=False
        )

    done = run("**/bad.urdf")
    assert (done.returncode, done.stdout.count("::error file=urdf/bad.urdf,")) == (1, 1)
    done = run("*.xml")
    assert (done.returncode, done.stdout) == (2, "::error::equipoise audit: no file is called *.xml\n")
    assert run("$(touch,hacked) `touch,hacked`").returncode == 3
    assert not (repository / "hacked").exists()


def git(folder, *words):
    identity = ("-c", "user.name=somebody", "-c", "user.email=somebody@localhost")
    subprocess.run(["git", *identity, *words], cwd=folder, check=True, capture_output=True)


@pytest.mark.skipif(not PROGRAM.exists(), reason="equipoise is not installed as a program")
def test_pre_commit_audits_a_repository(repository, tmp_path):
    """pre-commit uses the installed program, because installing one takes minutes."""
    pre_commit = shutil.which("pre-commit")
    if pre_commit is None:
        pytest.skip("pre-commit is not installed: the hook is NOT TRIED")
    ours = tmp_path / "ours"
    ours.mkdir()
    hooks = HOOKS.read_text(encoding="utf-8").replace("language: python", "language: system")
    (ours / HOOKS.name).write_text(hooks, encoding="utf-8")
    (repository / "notes.txt").write_text("no robot", encoding="utf-8")
    for folder in (ours, repository):
        git(folder, "init", "--quiet")
        git(folder, "add", ".")
        git(folder, "commit", "--quiet", "--message", "first")
    env = {**os.environ, "PRE_COMMIT_HOME": str(tmp_path / "home"), "PATH": f"{PROGRAM.parent}:{os.environ['PATH']}"}
    command = [pre_commit, "try-repo", str(ours), "equipoise-audit", "--files"]
    command += ["urdf/bad.urdf", "notes.txt"]
    done = subprocess.run(command, cwd=repository, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 1, done
    assert "error: trunk" in done.stdout
