"""Rendering of the report in a browser, in both themes, on paper and on a phone."""

import dataclasses
import functools
from contextlib import contextmanager

import pytest
from browser import open_browser

from equipoise.report.page import save_comparison, save_report

DRAW_ALL = "() => Promise.all(plots.map(draw)).then(() => null)"
DRAWN = "() => plots.map((plot) => Boolean(plot.querySelector('.cartesianlayer .trace path')))"
KINDS = ("bayesian", "paper", "comparison")
FIGURES = {"bayesian": 6, "paper": 9, "comparison": 2}  # at least


@pytest.fixture(scope="module")
def browser():
    yield from open_browser()


@pytest.fixture(scope="module")
def results(paper_result, bayesian_run):
    return {"bayesian": bayesian_run.result.with_truth(bayesian_run.truth), "paper": paper_result}


@pytest.fixture(scope="module")
def pages(results, tmp_path_factory):
    folder = tmp_path_factory.mktemp("reports")
    files = {name: save_report(result, folder / f"{name}.html") for name, result in results.items()}
    return {**files, "comparison": save_comparison(results, folder / "comparison.html")}


@contextmanager
def visits(browser):
    """Browser that opens files and collects their errors, checked at the end."""
    contexts, problems, requests = [], [], []

    def open_page(path, width=1280, height=800, init=None):
        context = browser.new_context(viewport={"width": width, "height": height}, offline=True)
        contexts.append(context)
        page = context.new_page()
        if init is not None:
            page.add_init_script(init)
        page.on("console", lambda message: problems.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.on("requestfailed", lambda request: problems.append(request.url))
        page.on("request", lambda request: requests.append(request.url))
        page.goto(path.as_uri())
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert problems == []
    assert [url for url in requests if not url.startswith(("file:", "data:", "blob:"))] == []


@pytest.fixture
def visit(browser):
    with visits(browser) as open_page:
        yield open_page


@pytest.fixture(scope="module")
def page_of(browser, pages):
    """Return one open page of each kind."""
    with visits(browser) as open_page:
        yield functools.cache(lambda kind: open_page(pages[kind]))


@pytest.mark.parametrize("kind", KINDS)
def test_every_figure_is_drawn_below_a_first_screen_that_holds_numbers_and_picture(visit, pages, kind):
    """Figures are drawn when they approach the viewport; on a phone the page scrolls vertically only."""
    page = visit(pages[kind])
    for part in (
        "#numbers tbody tr >> nth=0",
        "#numbers tbody tr >> nth=-1",
        "#plan-view .plot >> nth=0",
        "#plan-view .plot >> nth=1",
    ):
        box = page.locator(part).bounding_box()
        assert box["y"] >= 0
        assert box["y"] + box["height"] <= 800, part
        assert box["x"] + box["width"] <= 1280, part
    assert page.evaluate(
        "document.querySelector('#numbers .scroll').scrollWidth <= document.querySelector('#numbers').clientWidth"
    )
    if kind == "bayesian":
        assert_figures_below_are_drawn_when_they_come_near(page)
    page.evaluate(DRAW_ALL)
    page.wait_for_function(f"{DRAWN}.every(Boolean)")
    assert len(page.evaluate(DRAWN)) >= FIGURES[kind]
    ellipses = "plots[1].data.filter((trace) => trace.name.startsWith('95 % ellipse of')).length"
    assert page.evaluate(ellipses) == {"bayesian": 1, "paper": 0, "comparison": 1}[kind]
    page.set_viewport_size({"width": 400, "height": 800})
    page.wait_for_function("document.documentElement.scrollWidth <= 400")


def test_a_telephone_shows_every_number_with_its_verdict_and_no_word_broken(page_of):
    page = page_of("bayesian")
    page.set_viewport_size({"width": 360, "height": 780})
    rows = page.locator("#numbers tbody tr")
    for row in (rows.first, rows.last):
        for head in ("estimate", "95 % \u00b1", "interval", "verdict", "truth", "error", "model", "change"):
            box = row.locator(f'[data-head="{head}"]').bounding_box()
            assert box["x"] >= 0, head
            assert box["x"] + box["width"] <= 360, head
    assert page.locator("nav a").last.get_attribute("href") == "#provenance"
    page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    broken = """() => [...document.querySelectorAll('#trials td, #checks td')].filter((cell) => {
      const words = cell.textContent.split(' '), most = Math.max(...words.map((word) => word.length));
      const letter = parseFloat(getComputedStyle(cell).fontSize) / 2;
      return most < 20 && cell.clientWidth < most * letter; }).map((cell) => cell.textContent)"""
    assert page.evaluate(broken) == []


@pytest.mark.parametrize("kind", KINDS)
def test_no_table_is_cut_on_a_telephone(visit, pages, kind):
    page = visit(pages[kind], width=390, height=844)
    cut = """() => [...document.querySelectorAll('.scroll')].filter((one) => one.closest('details')?.open !== false)
      .filter((one) => one.scrollWidth > one.clientWidth + 1)
      .map((one) => one.querySelector('table').getAttribute('aria-label'))"""
    assert page.evaluate(cut) == []
    if kind == "bayesian":
        page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
        assert page.evaluate(cut) == []
        remedy = page.locator("#uncertainty tbody tr").first.locator('[data-head="remedy"]').bounding_box()
        assert remedy["x"] + remedy["width"] <= 390


def test_paper_is_wide_enough_for_the_numbers(visit, pages):
    page = visit(pages["bayesian"], width=688, height=970)  # A4 less its margins
    page.emulate_media(media="print")
    assert page.evaluate(
        "[...document.querySelectorAll('.barred')].every((table) => table.getBoundingClientRect().right <= 688)"
    )


def test_the_theme_is_the_systems(page_of):
    """Figures are drawn on white and inverted by the style sheet, so that saved figures are always on white."""
    background = "getComputedStyle(document.body).backgroundColor"
    plot = "getComputedStyle(plots[0]).filter"
    page = page_of("paper")
    page.emulate_media(color_scheme="light")
    assert page.evaluate(background) == "rgb(255, 255, 255)"
    assert page.evaluate(plot) == "none"
    page.emulate_media(color_scheme="dark")
    assert page.evaluate(background) != "rgb(255, 255, 255)"
    assert page.evaluate(plot) == "invert(0.9) hue-rotate(180deg)"


def test_figures_are_saved_from_the_page_without_a_network(page_of, tmp_path):
    page = page_of("paper")
    page.evaluate("() => Promise.all([draw(plots[2])]).then(() => null)")
    plot = page.locator(".plot").nth(2)
    plot.scroll_into_view_if_needed()
    for title, start in (("Save as SVG", b"<svg"), ("Download plot as a PNG", b"\x89PNG")):
        plot.hover()
        with page.expect_download() as download:
            plot.locator(f'[data-title="{title}"]').click()
        download.value.save_as(tmp_path / "figure")
        assert (tmp_path / "figure").read_bytes().startswith(start), title


def test_print_shows_all_numbers_and_figures(page_of, tmp_path):
    page = page_of("bayesian")
    page.set_viewport_size({"width": 688, "height": 970})  # A4 less its margins
    page.emulate_media(media="print", color_scheme="dark")
    assert page.evaluate(
        "[...document.querySelectorAll('.barred')].every((table) => table.getBoundingClientRect().right <= 688)"
    )
    page.emulate_media(media="screen")
    page.pdf(path=tmp_path / "report.pdf", format="A4")
    pdf = (tmp_path / "report.pdf").read_bytes()
    assert pdf.startswith(b"%PDF")
    assert all(page.evaluate(DRAWN))


def assert_figures_below_are_drawn_when_they_come_near(page):
    page.wait_for_timeout(200)
    assert not page.evaluate("Boolean(plots.at(-1).data)")
    page.evaluate("plots.at(-1).scrollIntoView()")
    page.wait_for_function("Boolean(plots.at(-1).data)")


def test_a_name_is_shown_and_never_run(visit, results, tmp_path):
    name = "</script><script>window.hurt = 1</script><img src=x onerror='window.hurt = 1'>"
    result = dataclasses.replace(results["bayesian"], robot=name)
    for path in (
        save_report(result, tmp_path / "one.html"),
        save_comparison({name: result, "<b>other": results["bayesian"]}, tmp_path / "two.html"),
    ):
        page = visit(path)
        page.evaluate(DRAW_ALL)
        assert page.evaluate("window.hurt") is None
        assert name in page.locator("main").inner_text()


def test_failed_checks_come_first(visit, results, tmp_path):
    bayesian = results["bayesian"]
    checks = tuple(dataclasses.replace(check, passed=False) for check in bayesian.checks[:2])
    failed = dataclasses.replace(bayesian, checks=checks, composite=bayesian.composite.doubted())
    page = visit(save_report(failed, tmp_path / "failed.html"))
    alerts, numbers = page.locator("#alerts"), page.locator("#numbers table")
    assert alerts.inner_text().count("Check failed:") == 2
    assert alerts.bounding_box()["y"] < numbers.bounding_box()["y"]
    assert numbers.bounding_box()["y"] + numbers.bounding_box()["height"] < 800
    words = [text.split(" ", 1) for text in numbers.locator(".verdict.poor").all_inner_texts()]
    assert [word for _, word in words] == [one.verdict for one in failed.composite]
    assert all(sign == "\u25cb" for sign, _ in words)
