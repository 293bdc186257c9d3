"""What the README says is what happens."""

import re
from pathlib import Path

import pytest
from documents import assert_shown

from equipoise import errors
from equipoise.cli import INTERRUPTED, main
from equipoise.result.requirements import UNMET

README = Path(__file__).parents[1] / "README.md"


@pytest.fixture(scope="module")
def text():
    return README.read_text(encoding="utf-8")


def test_the_first_command_prints_what_the_readme_shows(text, tmp_path, monkeypatch, capsys):
    """Engines of other versions step a little differently: half a millimetre, a tenth of a moment."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    command = re.search(r"^    equipoise (calibrate --payload.*)$", text, re.MULTILINE).group(1)
    assert main([*command.split(), "--no-pictures", "--no-report", "--quiet"]) == 0
    shown = re.search(r"```\n(unitree_a1: method precise.*?)```", text, re.DOTALL).group(1)
    printed = capsys.readouterr().out.partition("saved:")[0]
    assert_shown(plain(printed), plain(shown), abs=0.6, rel=0.1)
    assert main(["export", "runs/first", "--to", "urdf"]) == 0
    (shown,) = re.findall(r"```\n(warning: .*?)```", text, re.DOTALL)
    captured = capsys.readouterr()
    printed = (captured.err + captured.out).replace(f"{tmp_path.resolve()}/", "")
    assert_shown(printed, shown, abs=0, rel=0)


def plain(shown):
    """Without blank lines and ends of lines."""
    return "\n".join(line.rstrip() for line in shown.splitlines() if line.strip())


def test_the_readme_is_a_screen_and_a_half(text):
    assert len(text.splitlines()) < 100


def test_the_exit_codes_that_are_documented_are_those_of_the_errors():
    text = (README.parent / "docs" / "commands.md").read_text(encoding="utf-8")
    listed = {int(code) for code in re.findall(r"^\| (\d+) \|", text, re.MULTILINE)}
    raised = {
        error.exit_code
        for error in vars(errors).values()
        if isinstance(error, type) and issubclass(error, errors.EquipoiseError)
    }
    assert listed == raised | {0, 1, UNMET, INTERRUPTED}


@pytest.mark.parametrize(
    "target",
    [
        "demo",
        "test",
        "lint",
        "types",
        "bench",
        "bench-accuracy",
        "bench-balance",
        "bench-monte-carlo",
        "bench-peers",
        "bench-speed",
    ],
)
def test_make_has_the_targets_that_documents_name(target):
    makefile = README.with_name("Makefile").read_text(encoding="utf-8")
    assert re.search(rf"^{target}:", makefile, re.MULTILINE)


def test_files_that_the_readme_links_to_exist(text):
    for link in re.findall(r"\]\((?!http)([^)#]+)\)", text):
        assert (README.parent / link).exists(), link
