"""Size and legibility of the code against the budgets in size.toml: `make size` prints the table and lowers budgets.

A code line is neither blank, comment nor docstring. Style sheets, pages and scripts count by their lines. Every class counts,
also private ones, NamedTuples and those inside of others.
"""

import ast
import functools
import io
import re
import subprocess
import sys
import tokenize
from collections import Counter, defaultdict
from pathlib import Path
from statistics import quantiles

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "equipoise"
BUDGETS = Path(__file__).with_name("size.toml")
SLACK = 20  # lines by which a package may stay below its budget before the budget has to follow
CLAUSE = re.compile(r"^(Whether|What|How|Where|When|Who|Why|The same|Of |As |By |See |Such )")
ARCHAIC = re.compile(
    r"\b(told|tells|foretold|foretells?|heard|anew|beside|whoever|nobody|somebody|anybody|believed|guilty|witness|askew|"
    r"heed(s|ed)?|hangs? on|let go|looked at|speaks? against|gone on with|vouch(es|ed)?|is no|are no|its word|by itself)\b",
    re.IGNORECASE,
)
NO_CODE = {
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER
}  # fmt: skip
LOADED = (
    "import sys, os.path as p, equipoise; equipoise.calibrate; root = p.dirname(equipoise.__file__); "
    "print(*(p.relpath(m.__file__, root) for n, m in sys.modules.items() if n.split('.')[0] == 'equipoise'), sep='\\n')"
)


def docstrings(tree):
    """Yield every string expression that documents something."""
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        for child in body if isinstance(body, list) else ():
            if isinstance(child, ast.Expr) and isinstance(getattr(child.value, "value", None), str):
                yield child


def code_lines(source, tree):
    """Return the numbers of the lines that hold code, as a set."""
    lines = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in NO_CODE:
            lines.update(range(token.start[0], token.end[0] + 1))
    for node in docstrings(tree):
        lines.difference_update(range(node.lineno, node.end_lineno + 1))
    return lines


@functools.cache
def measured():
    """Return {table: {name: count}} in the layout of size.toml."""
    lines, classes, names, files = Counter(), Counter(), defaultdict(set), defaultdict(set)
    documented = clauses = archaic = words = untyped = 0
    lengths, by_file = [], {}
    for path in sorted(SOURCE.rglob("*.py")):
        source, package = path.read_text(encoding="utf-8"), package_of(path)
        tree = ast.parse(source)
        code = code_lines(source, tree)
        by_file[path.relative_to(SOURCE).as_posix()] = len(code)
        lines[package] += len(code)
        if path.name != "__init__.py":
            files[path.name].add(path)
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                classes[package] += 1
                names[node.name].add(path)
            elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                lengths.append(len(code & set(range(node.lineno, node.end_lineno + 1))))
                untyped += not node.name.startswith("_") and "dict[str, Any]" in ast.unparse(node).split(":\n")[0]
        for node in docstrings(tree):
            text = node.value.value
            documented += 1
            clauses += bool(CLAUSE.match(text.strip()))
            archaic += len(ARCHAIC.findall(text))
            words += len(text.split())
    for path in SOURCE.rglob("*"):
        if path.suffix in {".js", ".css", ".html"}:
            lines[package_of(path)] += len(path.read_text(encoding="utf-8").splitlines())
    for path in (ROOT / "benchmarks").rglob("*.py"):
        source = path.read_text(encoding="utf-8")
        lines["benchmarks"] += len(code_lines(source, ast.parse(source)))
    percentiles = quantiles(lengths, n=100)
    loaded = subprocess.run([sys.executable, "-c", LOADED], capture_output=True, text=True, check=True).stdout.split()
    reading = {
        "public_classes": sum(len(paths) for name, paths in names.items() if not name.startswith("_")),
        "class_names_used_twice": sum(len(p) > 1 for name, p in names.items() if not name.startswith("_")),
        "file_names_used_twice": sum(len(paths) > 1 for paths in files.values()),
        "exceptions": exceptions(),
        "public_functions_with_untyped_dicts": untyped,
        "function_length_median": round(percentiles[49]),
        "function_length_99th_percentile": round(percentiles[98]),
        "clause_docstrings_per_1000": round(1000 * clauses / documented),
        "archaic_words_per_10000_in_docstrings": round(1e4 * archaic / words),
        "lines_that_calibrate_loads": sum(by_file[path] for path in loaded),
        **documents(),
    }
    return {"lines": dict(lines), "classes": dict(classes), "reading": reading}


def documents():
    """Return counts of pages under docs/, of words in these and README, and of their sentences; prose only."""
    pages = sorted((ROOT / "docs").rglob("*.md"))
    text = "\n".join(page.read_text(encoding="utf-8") for page in (ROOT / "README.md", *pages))
    words = len(text.split())
    prose = re.sub(r"```.*?```|\$\$.*?\$\$|^(?:[|#>\-<!]| {4}).*?$", " ", text, flags=re.DOTALL | re.MULTILINE)
    lengths = [len(sentence.split()) for sentence in re.split(r"(?<=[.!?:;])\s+", prose) if sentence.strip()]
    return {
        "document_pages": len(pages),
        "document_words": words,
        "archaic_words_per_10000_in_documents": round(1e4 * len(ARCHAIC.findall(text)) / words),
        "sentences_over_30_words_per_1000": round(1000 * sum(length > 30 for length in lengths) / len(lengths)),
    }


def package_of(path):
    parts = path.relative_to(SOURCE).parts
    return parts[0] if len(parts) > 1 else "top"


def exceptions():
    """Return how many exceptions the package defines, the base class among them; a warning is none."""
    tree = ast.parse((SOURCE / "errors.py").read_text(encoding="utf-8"))
    return sum(isinstance(node, ast.ClassDef) and not node.name.endswith("Warning") for node in tree.body)


def budgets():
    """Return {table: {name: (budget, target)}}."""
    return tomllib.loads(BUDGETS.read_text(encoding="utf-8"))


def slack(table, budget):
    """Return the allowed excess of a budget over the measured value."""
    return SLACK if table == "lines" or budget > 1000 else 0


def lower():
    """Lower each budget to the measured value; an exceeded one does not change."""
    now, table, written = measured(), "", []
    for line in BUDGETS.read_text(encoding="utf-8").splitlines():
        row = re.fullmatch(r"(\w+ *= )\[(\d+), (\d+)\](.*)", line)
        if heading := re.fullmatch(r"\[(\w+)\]", line):
            table = heading[1]
        if row:
            lowered = min(int(row[2]), now[table].get(row[1].split()[0], 0))
            written.append(f"{row[1]}[{lowered}, {row[3]}]{row[4]}")
        else:
            written.append(line)
    BUDGETS.write_text("\n".join(written) + "\n", encoding="utf-8")


def table_of(now, wanted):
    """Return the lines of a Markdown table: measured, budget, target."""
    yield "| | now | budget | target |"
    yield "|---|---|---|---|"
    for table, rows in wanted.items():
        for name, (budget, target) in rows.items():
            yield f"| {table} {name.replace('_', ' ')} | {now[table].get(name, 0)} | {budget} | {target} |"
        if table != "reading":
            counted = [name for name in rows if name != "benchmarks"]
            sums = (sum(values) for values in zip(*(rows[name] for name in counted), strict=True))
            total = sum(now[table].get(name, 0) for name in counted)
            yield f"| **{table}, all but benchmarks** | {total} | {' | '.join(map(str, sums))} |"


if __name__ == "__main__":
    lower()
    print("\n".join(table_of(measured(), budgets())))
