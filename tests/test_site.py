"""What the site is made with: formulas, tables out of results, links of the repository, pictures."""

import re
import runpy
import sys
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import pytest

pytest.importorskip("mkdocs", reason="the site needs 'equipoise[docs]'")
ROOT = Path(__file__).parents[1]
MAKING = ROOT / "docs" / "making"
sys.path.insert(0, str(MAKING))
formulas, hooks = import_module("formulas"), import_module("hooks")
hash_of = import_module("sources").hash_of

PICTURES = sorted((ROOT / "docs" / "pictures").glob("*.svg"))


def test_a_formula_is_a_picture_of_the_texts_colour_with_its_source_for_those_who_cannot_see_it():
    set_ = formulas.with_formulas(r"with $x_m < 2$ metres")
    assert 'aria-label="x_m &lt; 2"' in set_
    assert "currentColor" in set_
    assert set_.startswith("with <svg")


def test_a_formula_on_its_own_has_its_number():
    assert '<span class="formula-number">(2)</span>' in formulas.with_formulas(r"$$ I \dot{\omega} = \tau \tag{2} $$")


@pytest.mark.parametrize("code", ["`$x$`", "```\n$x$\n```", "    echo $x and $y"])
def test_code_is_left_as_it_is(code):
    assert formulas.with_formulas(code) == code


def test_rows_of_a_result_come_with_their_head(tmp_path):
    result = tmp_path / "result.md"
    result.write_text("| a | b |\n|---|---|\n| one | 1 |\n| two | 2 |\n", encoding="utf-8")
    assert hooks.rows(result, 1, "two") == "| a | b |\n|---|---|\n| two | 2 |"
    with pytest.raises(ValueError, match="has no row like 'three'"):
        hooks.rows(result, 1, "three")


def test_the_table_of_unknowns_is_that_of_the_code():
    table = hooks.unknowns()
    assert "| `joint_zero`: encoder reading less joint position | joint | 0.005 rad |" in table
    assert "| 0.001 m times hip height | assumed; an indoor floor | moves |" in table
    assert hooks._UNKNOWNS in (ROOT / "docs" / "method" / "precise.md").read_text(encoding="utf-8")


def test_the_table_of_effects_is_that_of_the_code():
    table = hooks.effects()
    assert "| `springs` |  | 3000 Nm/rad | 3000 Nm/rad | stiffness of the spring between" in table
    assert "| `joint_zero` | 0.005 rad | 0.01 rad | 0.01 rad | encoder reading less joint position | joint |" in table
    assert "between a motor's encoder and the link | robot | exact | torque |" in table
    assert hooks._EFFECTS in (ROOT / "docs" / "method" / "world.md").read_text(encoding="utf-8")


OLDER = hooks.Page("benchmarks/accuracy.py", ("0123abc",), ("another hash",))


def test_a_results_page_of_older_code_has_a_mark_at_its_head_and_a_current_one_has_none():
    marked = hooks.with_banner("# Accuracy\n\nText.\n", OLDER)
    assert marked == (
        '# Accuracy\n\n!!! warning "Older code"\n    Made by older code: commit 0123abc; make it again with '
        "`make bench-accuracy`.\n\nText.\n"
    )
    current = OLDER._replace(hashes=(hash_of(OLDER.maker),))
    assert hooks.with_banner("# Accuracy\n\nText.\n", current) == "# Accuracy\n\nText.\n"


def test_links_to_pages_of_older_code_rows_of_them_and_pictures_are_marked(tmp_path, monkeypatch):
    results = tmp_path / "benchmarks" / "results"
    results.mkdir(parents=True)
    table = "| a | b |\n|---|---|\n| one | 1 |\n\n"
    for name, found in (("speed", "another hash"), ("size", hash_of("benchmarks/size.py"))):
        (results / f"{name}.md").write_text(f"{table}Made at commit 0123abc; sources {found}.\n", encoding="utf-8")
    svg = "<svg></svg>"
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "drawn.svg").write_text(svg, encoding="utf-8")
    for module in (hooks, sys.modules["provenance"]):
        monkeypatch.setattr(module, "RESULTS", results)
    monkeypatch.setattr(hooks, "ROOT", tmp_path)
    page = SimpleNamespace(file=SimpleNamespace(src_uri="accuracy.md"))

    def made(markdown):
        return hooks.on_page_markdown(markdown, page, None, None)

    assert made("[speed](../benchmarks/results/speed.md#a) of").endswith("speed.md#a) (older code) of")
    assert made("[size](../benchmarks/results/size.md) of").endswith("size.md) of")
    assert "*Rows made by older code: commit 0123abc.*" in made(
        "<!-- rows of benchmarks/results/speed.md, table 1: one -->"
    )
    assert "older" not in made("<!-- rows of benchmarks/results/size.md, table 1: one -->")
    assert "speed.md (older code)." in made("![Drawn from benchmarks/results/speed.md.](drawn.svg)")
    assert "older" not in made("![Drawn from benchmarks/results/size.md.](drawn.svg)")


@pytest.mark.parametrize(
    ("target", "page", "link"),
    [
        ("../benchmarks/results/logs.md", "logs.md", "benchmarks/results/logs.md"),
        ("../../benchmarks/results/logs.md", "method/paper.md", "../benchmarks/results/logs.md"),
        ("accuracy_paper.md", "benchmarks/results/peers.md", "accuracy_paper.md"),
        ("../CONTRIBUTING.md", "home-built.md", "CONTRIBUTING.md"),
        ("../README.md", "logs.md", "index.md"),
    ],
)
def test_links_of_the_repository_are_links_of_the_site(target, page, link):
    here = str((ROOT / hooks._in_repository(page)).parent.relative_to(ROOT))
    assert hooks._linked(target, page, here) == link


@pytest.mark.parametrize("picture", PICTURES, ids=lambda path: path.stem)
def test_a_picture_is_small_needs_nothing_and_is_shown(picture):
    svg = picture.read_text(encoding="utf-8")
    assert len(svg) < 100_000
    assert not re.search(r"(?:href|src)=\"http|url\(http|@import", svg)
    pages = (page.read_text(encoding="utf-8") for page in (ROOT / "docs").rglob("*.md"))
    assert any(f"pictures/{picture.name})" in page for page in pages)


def test_every_picture_is_made_by_a_command():
    made = runpy.run_path(str(MAKING / "pictures" / "__main__.py"))
    assert set(made["PICTURES"]) == {path.stem for path in PICTURES}


def test_nothing_comes_from_elsewhere():
    style = (ROOT / "docs" / "assets" / "equipoise.css").read_text(encoding="utf-8")
    settings = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    assert "font: false" in settings
    assert "extra_javascript" not in settings
    assert not re.search(r"url\(|@import", style)
