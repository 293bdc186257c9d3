"""TeX formulas as SVG that takes the text's colour and size: no script, no fonts, nothing from the network.

Matplotlib's mathtext sets them; it knows most of what a formula needs, without matrices.
"""

import html
import re
from functools import cache

import matplotlib
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path
from matplotlib.textpath import TextToPath

matplotlib.rcParams["mathtext.fontset"] = "stix"
_EM = TextToPath.FONT_SCALE
_SETTER = TextToPath()
_LETTERS = {Path.MOVETO: "M", Path.LINETO: "L", Path.CURVE3: "Q", Path.CURVE4: "C"}
# Code is left as it is: fenced, in a line, indented.
_FORMULA = re.compile(
    r"(?P<code>^```.*?^```|`[^`\n]*`|^ {4}[^\n]*)|\$\$(?P<block>.+?)\$\$|\$(?!\s)(?P<line>[^$\n]+?)(?<!\s)\$",
    re.DOTALL | re.MULTILINE,
)
_TAG = re.compile(r"\\tag\{(.+?)\}")


def with_formulas(markdown: str) -> str:
    r"""A page with $...$ and $$...$$ set. \tag{2} numbers a formula."""
    return _FORMULA.sub(_replaced, markdown)


def _replaced(match: re.Match[str]) -> str:
    if match["code"] is not None:
        return match[0]
    if match["line"] is not None:
        return _svg(match["line"])
    tag = _TAG.search(match["block"])
    number = "" if tag is None else f'<span class="formula-number">({tag[1]})</span>'
    lines = [line.strip() for line in _TAG.sub("", match["block"]).split(r"\\")]
    return f'<div class="formula"><div>{"".join(map(_svg, lines))}</div>{number}</div>'


@cache
def _svg(tex: str) -> str:
    tex = " ".join(tex.split())
    font = FontProperties(size=_EM)
    width, height, depth, _, _ = _SETTER.mathtext_parser.parse(f"${tex}$", 72, font)
    path = _data(*_SETTER.get_text_path(font, f"${tex}$", ismath=True))
    size = f"width:{width / _EM:.2f}em;height:{height / _EM:.2f}em;vertical-align:{-depth / _EM:.2f}em"
    box = f"0 {depth - height:.0f} {width:.0f} {height:.0f}"
    label = html.escape(tex, quote=True)
    return (
        f'<svg class="math" role="math" aria-label="{label}" style="{size}" viewBox="{box}">'
        f'<path fill="currentColor" d="{path}"/></svg>'
    )


def _data(vertices, codes) -> str:
    """Path data in whole hundredths of an em, y downward."""
    parts, index = [], 0
    while index < len(codes):
        code = codes[index]
        if code == Path.CLOSEPOLY:
            parts.append("Z")
            index += 1
            continue
        count = {Path.CURVE3: 2, Path.CURVE4: 3}.get(code, 1)
        points = vertices[index : index + count]
        parts.append(_LETTERS[code] + " ".join(f"{x:.1f} {-y:.1f}".replace(".0", "") for x, y in points))
        index += count
    return "".join(parts)
