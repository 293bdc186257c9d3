"""Hooks of MkDocs: pages outside of docs/, tables from results and code, formulas, pictures.

Documents are written so that they read well in the repository too: links are those of the repository. A link on a line of its
own to a file with a table becomes that table on the site: "[Table 1: unitree_a1](...)" is the rows of the first table of a
results page whose first cells match "unitree_a1".

A results page that older code made is marked, and so are links to it, rows of it and pictures that are drawn from it.
"""

import html
import posixpath
import re
import sys
from pathlib import Path

from mkdocs.structure.files import File

sys.path.insert(0, str(Path(__file__).parent))
sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
from formulas import with_formulas
from provenance import RESULTS, Page
from reference import exit_codes, flags, public_names, robot_keys, verbs

from equipoise.estimator.equations.table import EQUATIONS
from equipoise.estimator.unknowns import Priors
from equipoise.simulation.effects import EffectSizes

ROOT = Path(__file__).parents[2]
_SHOWN = ("CONTRIBUTING.md", "CHANGELOG.md", "benchmarks/results/**/*.md", "benchmarks/results/**/*.png")
_LINK = re.compile(r"(?<=\]\()(?!https?:|#|mailto:)([^)#\s]+)")
_PICTURE = re.compile(r"!\[([^\]]*)\]\((\S+?\.svg)\)")
_ROWS = re.compile(r"^\[Table (\d+): (.+)\]\((?:\.\./)+(\S+)\)$", re.MULTILINE)
_TO_RESULTS = re.compile(r"\]\(([^)#\s]*\.md)(#[^)\s]*)?\)")
_DRAWN_FROM = re.compile(r"Drawn from (\S+\.md)")
_OLDER = "(older code)"
_UNKNOWNS = "[Table of parameters](../../src/equipoise/estimator/unknowns.py)"
_EFFECTS = "[Table of effects](../src/equipoise/simulation/effects.py)"
_FLAGS = "[Flags of every verb](../../src/equipoise/cli/__init__.py)"
_VERBS = "[Table of verbs](../../src/equipoise/cli/__init__.py)"
_EXIT_CODES = "[Table of exit codes](../../src/equipoise/errors.py)"
_ROBOT_KEYS = "[Table of keys](../../src/equipoise/robot/description.py)"
_NAMES = "[Stable names](../../src/equipoise/__init__.py)"


def on_files(files, config):
    """Add what is shown and lives outside of docs/."""
    for pattern in _SHOWN:
        for path in sorted(ROOT.glob(pattern)):
            uri = path.relative_to(ROOT).as_posix()
            files.append(File.generated(config, uri, abs_src_path=str(path)))
    return files


def on_page_markdown(markdown, page, config, files):
    """Return the page in the form that MkDocs takes."""
    source = ROOT / _in_repository(page.file.src_uri)
    if source.is_relative_to(RESULTS):
        markdown = with_banner(markdown, Page.read(source))
    markdown = _ROWS.sub(
        lambda found: rows(ROOT / found[3], int(found[1]), found[2]) + _rows_note(ROOT / found[3]), markdown
    )
    for placeholder, table in _TABLES.items():
        if placeholder in markdown:
            markdown = markdown.replace(placeholder, table())
    here = posixpath.dirname(_in_repository(page.file.src_uri))
    markdown = _PICTURE.sub(lambda found: _inlined(found[1], ROOT / posixpath.normpath(f"{here}/{found[2]}")), markdown)
    if source.name != "CHANGELOG.md":  # its entries are dated
        markdown = _TO_RESULTS.sub(
            lambda found: found[0] + _mark(ROOT / posixpath.normpath(f"{here}/{found[1]}")), markdown
        )
    markdown = _LINK.sub(lambda found: _linked(found[1], page.file.src_uri, here), markdown)
    return with_formulas(markdown)


def with_banner(markdown: str, page: Page) -> str:
    """Return a results page, with a mark at its head if older code made it."""
    if page.is_current:
        return markdown
    title, rest = re.fullmatch(r"(\s*# [^\n]*\n)(.*)", markdown, re.DOTALL).groups()
    return f'{title}\n!!! warning "Older code"\n    {page.banner}\n{rest}'


def _mark(file: Path) -> str:
    """Return the mark behind a link to a results page that older code made; else nothing."""
    return f" {_OLDER}" if file.is_relative_to(RESULTS) and file.is_file() and not Page.read(file).is_current else ""


def _rows_note(file: Path) -> str:
    """Return the note below rows of a results page that older code made; else nothing."""
    return f"\n\n*Rows made by older code: commit {', '.join(Page.read(file).commits)}.*\n" if _mark(file) else ""


def rows(file: Path, number: int, wanted: str) -> str:
    """Rows of the n-th table of a result whose first cells match a regular expression, with the table's head."""
    tables = re.findall(r"(?:^\|.*\n)+", file.read_text(encoding="utf-8"), re.MULTILINE)
    head, rule, *body = tables[number - 1].splitlines()
    chosen = [row for row in body if re.match(wanted, row.strip("| "))]
    if not chosen:
        raise ValueError(f"{file}: table {number} has no row like {wanted!r}")
    return "\n".join([head, rule, *chosen])


def unknowns() -> str:
    """Return the table of the Bayesian method's parameters."""
    lines = ["| parameter | one for each | prior std | source | used by |", "|---|---|---|---|---|"]
    for row in Priors.rows():
        prior = f"{row.usual:g} {row.unit}".strip()
        prior += f" times {row.measure.name}" if row.measure.name else ""
        enters = ", ".join(kind.name for kind in EQUATIONS if row.name in kind.depends_on)
        lines.append(f"| `{row.name}`: {row.meaning} | {row.each.name} | {prior} | {row.source} | {enters} |")
    return "\n".join(lines)


def effects() -> str:
    """Return the table of the simulation's effects."""
    lines = [
        "| effect | `realistic` | `stress` | alone | meaning | one for each | distribution | scales with | source | engines |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in EffectSizes.rows():
        sizes = (row.realistic, row.in_stress, row.size_alone)
        shown = ["" if size == row.none else f"{_short(size)} {row.unit}".strip() for size in sizes]
        about = [row.meaning, row.each, row.law, row.measure, row.source, ", ".join(row.engines)]
        lines.append("| " + " | ".join([f"`{row.name}`", *shown, *about]) + " |")
    return "\n".join(lines)


def _short(size: float) -> str:
    """Three digits, and no exponents for what is large."""
    return f"{size:.0f}" if size >= 100 else f"{size:.3g}"


def _in_repository(uri: str) -> str:
    """Path in the repository of a page of the site."""
    return uri if (ROOT / uri).exists() else f"docs/{uri}"


def _linked(target: str, uri: str, here: str) -> str:
    """A link of the repository as one of the site."""
    path = posixpath.normpath(posixpath.join(here, target))
    if path == "README.md":
        path = "docs/index.md"
    return posixpath.relpath(path.removeprefix("docs/"), posixpath.dirname(uri) or ".")


def _inlined(caption: str, file: Path) -> str:
    """A picture in the page itself, so that its colours follow the page's."""
    caption = _DRAWN_FROM.sub(lambda found: found[0] + _mark(ROOT / found[1]), caption)
    svg = re.sub(r"<\?xml.*?\?>|<!DOCTYPE.*?>", "", file.read_text(encoding="utf-8"), flags=re.DOTALL)
    svg = " ".join(svg.split())
    # Names within a picture must not meet those of another one.
    for name in set(re.findall(r'id="([^"]+)"', svg)):
        svg = re.sub(rf'(id="|#){re.escape(name)}(?=["\)])', rf"\g<1>{file.stem}-{name}", svg)
    words = html.escape(caption, quote=True)
    return (
        f'<figure class="picture picture-{file.stem}" role="img" aria-label="{words}">{svg}'
        f"<figcaption>{words}</figcaption></figure>"
    )


_TABLES = {
    _UNKNOWNS: unknowns, _EFFECTS: effects, _FLAGS: flags, _VERBS: verbs, _EXIT_CODES: exit_codes,
    _ROBOT_KEYS: robot_keys, _NAMES: public_names
}  # fmt: skip
"""Functions that write the tables of code, by the placeholder on the page."""
