"""Hooks of the site: formulas, tables from results and code, links of the repository, pictures."""

import dataclasses
import re
import runpy
import sys
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import pytest
from browser import open_browser

import equipoise
from equipoise import cli, errors

pytest.importorskip("mkdocs", reason="the site needs 'equipoise[docs]'")
ROOT = Path(__file__).parents[1]
MAKING = ROOT / "docs" / "making"
sys.path.insert(0, str(MAKING))
formulas, hooks = import_module("formulas"), import_module("hooks")
hash_of = import_module("sources").hash_of

WORKER = ROOT / "docs" / "assets" / "iframe-worker.js"
PAGES = sorted((ROOT / "docs").rglob("*.md"))
PICTURES = sorted((ROOT / "docs" / "pictures").glob("*.svg"))


def test_a_formula_is_a_picture_in_the_texts_colour_with_its_source_as_alternative_text():
    set_ = formulas.with_formulas(r"with $x_m < 2$ metres")
    assert 'aria-label="x_m &lt; 2"' in set_
    assert "currentColor" in set_
    assert set_.startswith("with <svg")


def test_a_formula_on_its_own_has_its_number():
    assert '<span class="formula-number">(2)</span>' in formulas.with_formulas(r"$$ I \dot{\omega} = \tau \tag{2} $$")


@pytest.mark.parametrize("code", ["`$x$`", "```\n$x$\n```", "    echo $x and $y"])
def test_code_is_left_as_it_is(code):
    assert formulas.with_formulas(code) == code


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_list_begins_after_an_empty_line(page):
    """Otherwise the site shows it as part of the paragraph before it."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    assert not re.findall(r"^(?!- |\d+\. |\s).+\n- .*", text, flags=re.MULTILINE)


def test_rows_of_a_result_come_with_their_head(tmp_path):
    result = tmp_path / "result.md"
    result.write_text("| a | b |\n|---|---|\n| one | 1 |\n| two | 2 |\n", encoding="utf-8")
    assert hooks.rows(result, 1, "two") == "| a | b |\n|---|---|\n| two | 2 |"
    with pytest.raises(ValueError, match="has no row like 'three'"):
        hooks.rows(result, 1, "three")


def test_the_table_of_unknowns_is_that_of_the_code():
    table = hooks.unknowns()
    assert "| `joint_offset`: encoder reading less joint position | joint | 0.005 rad |" in table
    assert "| 0.001 m times hip height | assumed; an indoor floor | moves |" in table
    assert hooks._UNKNOWNS in (ROOT / "docs" / "how-it-works" / "bayesian-method.md").read_text(encoding="utf-8")


def test_verbs_and_exit_codes_are_those_of_the_code():
    verbs, codes = hooks.verbs(), hooks.exit_codes()
    assert verbs.startswith("| verb | purpose |")
    assert all(f"| [`{verb}`](#" in verbs for verb in (*cli.VERBS, "lab balance"))
    assert "| 5 | `RecordingError` | " in codes
    listed = {int(code) for code in re.findall(r"^\| (\d+) \|", codes, re.MULTILINE)}
    raised = {
        error.exit_code for error in vars(errors).values() if isinstance(error, type) and hasattr(error, "exit_code")
    }
    assert listed == raised - {1}  # 1: the base class


def test_the_table_of_effects_is_that_of_the_code():
    table = hooks.effects()
    assert "| `springs` |  | 3000 Nm/rad | 3000 Nm/rad | stiffness of the spring between" in table
    assert "| `joint_offset` | 0.005 rad | 0.01 rad | 0.01 rad | encoder reading less joint position | joint |" in table
    assert "between a motor's encoder and the link | robot | exact | torque |" in table
    assert hooks._EFFECTS in (ROOT / "docs" / "simulation-studies.md").read_text(encoding="utf-8")


def test_flags_are_those_of_the_help_and_a_group_of_an_earlier_verb_is_not_repeated():
    shown = hooks.flags()
    for verb in (*cli.VERBS, *(f"{group} {verb}" for group in cli.GROUPS for verb in cli.GROUPS[group])):
        assert f"## `{verb}` {{ #{verb.replace(' ', '-')} }}" in shown
    assert shown.count("| `--imu-rpy ROLL PITCH YAW` |") == 1
    assert "Robot options: see [`calibrate`](#calibrate)." in shown
    assert "| `--motor-time TIME` | " in shown
    assert "-----" not in shown.replace("|---|---|", "")


def test_keys_of_the_robot_configuration_are_those_of_the_code():
    table = hooks.robot_keys()
    assert "| `imu_position` | three numbers | IMU position in the base frame &#91;m&#93;. |" in table
    assert table.count("\n") == len(dataclasses.fields(equipoise.RobotDescription)) + 1


def test_every_stable_name_has_its_directive():
    directives = re.findall(r"^::: equipoise\.\S+\.(\w+)$", hooks.public_names(), re.MULTILINE)
    assert sorted(directives) == sorted(name for name in equipoise.__all__ if not name.startswith("_"))
    named = set(re.findall(r"`(\w+)`", (ROOT / "docs" / "reference" / "python-api.md").read_text(encoding="utf-8")))
    assert set(directives) <= named


def test_each_placeholder_is_on_one_page():
    pages = [page.read_text(encoding="utf-8") for page in PAGES]
    for placeholder in hooks._TABLES:
        assert sum(placeholder in page for page in pages) == 1, placeholder


def test_every_page_is_in_the_navigation_and_benchmarks_lists_every_result():
    navigation = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:")[2]
    listed = re.findall(r": (\S+\.md)$", navigation, re.MULTILINE)
    pages = {page.relative_to(ROOT / "docs").as_posix() for page in PAGES}
    assert sorted(listed) == sorted(pages | {"CONTRIBUTING.md", "CHANGELOG.md"})
    benchmarks = (ROOT / "docs" / "benchmarks.md").read_text(encoding="utf-8")
    for result in (ROOT / "benchmarks" / "results").rglob("*.md"):
        assert benchmarks.count(f"](../{result.relative_to(ROOT).as_posix()})") == 1, result


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
    for name, found in (("speed", "another hash"), ("robots", hash_of("benchmarks/robots.py"))):
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
    assert made("[robots](../benchmarks/results/robots.md) of").endswith("robots.md) of")
    assert "*Rows made by older code: commit 0123abc.*" in made("[Table 1: one](../benchmarks/results/speed.md)")
    assert "older" not in made("[Table 1: one](../benchmarks/results/robots.md)")
    assert "speed.md (older code)." in made("![Drawn from benchmarks/results/speed.md.](drawn.svg)")
    assert "older" not in made("![Drawn from benchmarks/results/robots.md.](drawn.svg)")


@pytest.mark.parametrize(
    ("target", "page", "link"),
    [
        ("../benchmarks/results/logs.md", "logs.md", "benchmarks/results/logs.md"),
        ("../../benchmarks/results/logs.md", "how-it-works/paper-method.md", "../benchmarks/results/logs.md"),
        ("accuracy_paper.md", "benchmarks/results/peers.md", "accuracy_paper.md"),
        ("../CONTRIBUTING.md", "your-robot.md", "CONTRIBUTING.md"),
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
    pages = (page.read_text(encoding="utf-8") for page in PAGES)
    assert any(f"pictures/{picture.name})" in page for page in pages)


def test_every_picture_is_made_by_a_command():
    made = runpy.run_path(str(MAKING / "pictures" / "__main__.py"))
    assert set(made["PICTURES"]) == {path.stem for path in PICTURES}


def test_the_site_loads_nothing_from_other_sites():
    style = (ROOT / "docs" / "assets" / "equipoise.css").read_text(encoding="utf-8")
    settings = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    assert "font: false" in settings
    assert "extra_javascript" not in settings
    assert "polyfills: [assets/iframe-worker.js]" in settings
    assert "http" not in WORKER.read_text(encoding="utf-8")
    assert not re.search(r"url\(|@import", style)


@pytest.fixture
def browser():
    yield from open_browser()


def test_the_search_has_its_worker_in_a_page_that_is_opened_from_a_disk(browser, tmp_path):
    (tmp_path / "double.js").write_text("addEventListener('message', (event) => postMessage(2 * event.data))", "utf-8")
    page = "<script src='worker.js'></script><script>const worker = new Worker('double.js')</script>"
    (tmp_path / "page.html").write_text(f"<body>{page}</body>", encoding="utf-8")
    (tmp_path / "worker.js").write_bytes(WORKER.read_bytes())
    shown = browser.new_page()
    shown.goto((tmp_path / "page.html").as_uri())
    answer = "new Promise((done) => worker.addEventListener('message', (event) => done(event.data)))"
    assert shown.evaluate(f"[worker.postMessage(21), {answer}][1]") == 42
