"""Commands of docs/reference/exports.md run and write the output of the page."""

import re
import shlex
from pathlib import Path

import pytest
from exporting import CONST, INERTIAL, SDF, make_run, usd
from robots import load_text, quadruped_mjcf

from equipoise.cli import main
from equipoise.exports.formats import FORMATS

PAGE = Path(__file__).parents[1] / "docs" / "reference" / "exports.md"
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
    """Return a folder with the files that the page's commands need."""
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


def sections():
    """Return the sections of the page by their headings."""
    return dict(re.findall(r"^## (.+)\n((?:(?!## ).*\n)+)", PAGE.read_text(encoding="utf-8"), re.MULTILINE))


@pytest.mark.parametrize("section", sections())
def test_commands_run_and_write_the_output_of_the_page(section, folder, monkeypatch, capsys):
    text = sections()[section]
    if "--to usd" in text:
        pytest.importorskip("pxr", reason="usd-core is not installed: USD is NOT TRIED")
    monkeypatch.chdir(folder)
    commands, written = COMMAND.findall(text), ""
    assert commands or section == "Tests"
    for command in commands:
        assert main(shlex.split(command)) == 0, command
        printed = capsys.readouterr()
        saved = re.search(r"^saved: (.*)$", printed.out, re.MULTILINE)
        written += printed.out + (Path(saved[1]).read_text(encoding="utf-8") if saved else "")
    for language, block in BLOCK.findall(text):
        if "from equipoise" in block:
            exec(compile(block, PAGE.name, "exec"), {})
            continue
        missing = masked(block) - masked(written)
        assert not missing, (language, missing)


def test_the_table_names_every_format_and_the_parts_that_it_holds():
    text = PAGE.read_text(encoding="utf-8")
    anchors = {heading.lower().replace(" ", "-") for heading in sections()}
    for row in FORMATS.values():
        assert row.page in anchors
        assert f"(#{row.page})" in text
        line = next(line for line in text.splitlines() if line.startswith("|") and f"`{row.name}`" in line)
        assert line.endswith(f"| {', '.join(row.holds)} |")
