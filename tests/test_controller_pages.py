"""docs/controllers: every command in the pages runs, and what they show is what is written."""

import re
import shlex
from pathlib import Path

import pytest
from exporting import CONST, INERTIAL, SDF, make_run, usd
from robots import load_text, quadruped_mjcf

from equipoise.cli import main
from equipoise.exports.formats import FORMATS

PAGES = Path(__file__).parents[1] / "docs" / "controllers"
COMMAND = re.compile(r"^    equipoise (export.*?)(?:\s+#.*)?$", re.MULTILINE)
BLOCK = re.compile(r"```(\w+)\n(.*?)```", re.DOTALL)
MJCF = re.sub(
    r"(<freejoint/>)<inertial [^>]*/>",
    r'\1<inertial pos="0 0 0" quat="1 0 0 0"\n  mass="6"\n  diaginertia="0.02 0.06 0.065" />',
    quadruped_mjcf(),
)
NUMBER = re.compile(r"-?\b\d+\.?\d*(?:e[-+]?\d+)?")


@pytest.fixture(scope="module")
def folder(a1, tmp_path_factory):
    """What the pages' commands find where they run."""
    folder = tmp_path_factory.mktemp("user")
    make_run(folder / "runs" / "a1", a1)
    make_run(folder / "runs" / "mjcf", load_text(folder, MJCF.replace("><", ">\n<"), name="robot.xml"))
    (folder / "my_robot.urdf").write_bytes(a1.source.path.read_bytes())
    (folder / "const.xacro").write_text(CONST, encoding="utf-8")
    (folder / "model.sdf").write_text(SDF.format(INERTIAL), encoding="utf-8")
    (folder / "a1.usda").write_text(usd(a1), encoding="utf-8")
    return folder


def masked(text):
    return {NUMBER.sub("#", line.strip()) for line in text.splitlines()}


@pytest.mark.parametrize("page", sorted(PAGES.glob("*.md")), ids=lambda page: page.stem)
def test_commands_run_and_write_what_the_page_shows(page, folder, monkeypatch, capsys):
    if page.stem == "usd":
        pytest.importorskip("pxr", reason="usd-core is not installed: USD is NOT TRIED")
    monkeypatch.chdir(folder)
    text = page.read_text(encoding="utf-8")
    commands, written = COMMAND.findall(text), ""
    assert commands
    for command in commands:
        assert main(shlex.split(command)) == 0, command
        printed = capsys.readouterr()
        saved = re.search(r"^saved: (.*)$", printed.out, re.MULTILINE)
        written += printed.out + (Path(saved[1]).read_text(encoding="utf-8") if saved else "")
    for language, block in BLOCK.findall(text):
        if "from equipoise" in block:
            exec(compile(block, page.name, "exec"), {})
            continue
        unknown = masked(block) - masked(written)
        assert not unknown, (language, unknown)


def test_every_format_has_a_page_and_the_index_names_all():
    index = (PAGES / "README.md").read_text(encoding="utf-8")
    for row in FORMATS.values():
        assert (PAGES / f"{row.page}.md").exists()
        assert f"({row.page}.md)" in index
        assert f"`{row.name}`" in index
        line = next(line for line in index.splitlines() if line.startswith("|") and f"`{row.name}`" in line)
        assert line.endswith(f"| {', '.join(row.holds)} |")


@pytest.mark.parametrize("page", sorted(PAGES.glob("*.md")), ids=lambda page: page.stem)
def test_links_lead_somewhere(page):
    for link in re.findall(r"\]\((?!http)([^)#]+)\)", page.read_text(encoding="utf-8")):
        assert (page.parent / link).exists(), link
