"""Sources of a program in this repository: the modules that it imports, directly or indirectly, and their data files.

Modules are parsed at any commit, not imported. Imports in functions count, as do dotted paths in strings (tables of modules
that are loaded by name), `-m equipoise`, and named files next to a module. Hashes are of syntax trees without docstrings,
because comments, layout and docstrings do not change results.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import io
import re
import subprocess
import tarfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
UNKNOWN = "unknown"
FOLDERS = ("benchmarks", "src/equipoise")
"""Folders of the sources."""
# Without effect on results.
_BOOKKEEPING = {"benchmarks/provenance.py", "benchmarks/sources.py", "src/equipoise/_version.py"}
_MODULE = re.compile(r"\bequipoise(?:\.\w+)+(?![\w.])")
_HASH_LENGTH = 12


@dataclass(frozen=True, eq=False)
class Tree:
    """Sources of one commit, or of the working tree."""

    files: Mapping[str, bytes]
    """Content by path from the repository's root."""

    @functools.cached_property
    def folders(self) -> frozenset[str]:
        """Paths of all folders with files, at any depth."""
        return frozenset(str(folder) for path in self.files for folder in PurePosixPath(path).parents)


@functools.cache
def hash_of(maker: str, at: str = "") -> str:
    """Return the hash of the sources of a page's maker in the working tree, or at a commit; `UNKNOWN` without that commit."""
    tree = tree_of(at)
    if tree is None or maker not in tree.files:
        return UNKNOWN
    found = sources(maker, tree)
    return _hash("".join(f"{path} {found[path]}\n" for path in sorted(found)).encode())


def changes(maker: str, at: str) -> tuple[int, int] | None:
    """Count the present sources that differ or are missing at a commit, and all of them; None without that commit."""
    then, today = tree_of(at), tree_of()
    if then is None or today is None:
        return None
    paths = sources(maker, today)
    return sum(path not in then.files or not _same(path, then.files[path], today.files[path]) for path in paths), len(
        paths
    )


def _same(path: str, one: bytes, other: bytes) -> bool:
    return one == other or _digest(path, one) == _digest(path, other)


@functools.cache
def tree_of(at: str = "") -> Tree | None:
    """Return the sources of the working tree, or of a commit; None if git does not have it."""
    if not at:
        paths = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*") if path.is_file()]
        return Tree({name: path.read_bytes() for path in paths if _counts(name := path.relative_to(ROOT).as_posix())})
    try:
        command = ["git", "-C", str(ROOT), "archive", "--format=tar", at, *FOLDERS]
        packed = subprocess.run(command, capture_output=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return None
    with tarfile.open(fileobj=io.BytesIO(packed)) as archive:
        files = [member for member in archive.getmembers() if member.isfile() and _counts(member.name)]
        return Tree({file.name: archive.extractfile(file).read() for file in files})


def _counts(path: str) -> bool:
    return not path.startswith("benchmarks/results/") and "__pycache__" not in path and path not in _BOOKKEEPING


def sources(maker: str, tree: Tree) -> dict[str, str]:
    """Return the digest of each file that a maker imports, directly or indirectly, by path."""
    found: dict[str, str] = {}
    seen, waiting = set(), [(maker, False)]
    while waiting:
        path, as_parent = file = waiting.pop()
        if file not in seen:
            seen.add(file)
            found[path] = _digest(path, tree.files[path])
            waiting += _used(path, tree, as_parent) if path.endswith(".py") else ()
    return found


@functools.cache
def _used(path: str, tree: Tree, as_parent: bool) -> frozenset[tuple[str, bool]]:
    """Return the paths that a module imports or reads, each with a flag: true for a parent package of another module.

    Modules to which a parent package dispatches do not count.
    """
    folder = PurePosixPath(path).parent.as_posix()
    found = {(data, False) for data in _data(path, tree)}
    for name in _read(tree.files[path]).names:
        if name.endswith(".*"):
            inside = "src/" + name[:-2].replace(".", "/")
            found |= {(one, False) for one in tree.files if not as_parent and str(PurePosixPath(one).parent) == inside}
        else:
            for place in {"src/", "benchmarks/", f"{folder}/"} if path.startswith("benchmarks/") else {"src/"}:
                found |= {*_resolved(name, place, tree)}
    return frozenset(found)


def _resolved(name: str, place: str, tree: Tree) -> Iterator[tuple[str, bool]]:
    """Yield the files of a dotted name below a folder: the module, packages above it, and the home of a re-exported name."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        base = place + "/".join(parts[:count])
        path = next((one for one in (f"{base}.py", f"{base}/__init__.py") if one in tree.files), None)
        if path is None:
            continue
        yield path, False
        yield from ((parent, True) for parent in _parents(path, place) if parent in tree.files and parent != path)
        if (
            path.endswith("/__init__.py")
            and count < len(parts)
            and (home := _read(tree.files[path]).bound.get(parts[count]))
        ):
            yield from _resolved(home, place, tree)
        return


def _parents(path: str, place: str) -> Iterator[str]:
    for folder in PurePosixPath(path).parents:
        if f"{folder}/" == place:
            return
        yield f"{folder}/__init__.py"


def _data(path: str, tree: Tree) -> Iterator[str]:
    """Yield files, and files in folders, that a module names by their paths from its own folder or from the package."""
    folder = PurePosixPath(path).parent.as_posix()
    for text in _read(tree.files[path]).texts:
        for named in (f"{folder}/{text}", f"src/equipoise/{text}"):
            if named in tree.files:
                yield named
            elif named in tree.folders and f"{named}/__init__.py" not in tree.files:
                yield from (one for one in tree.files if one.startswith(f"{named}/"))


class _Module(NamedTuple):
    names: tuple[str, ...]
    """Dotted names that it uses; one that ends in `.*` is a package whose modules it imports by name."""
    bound: Mapping[str, str]
    """Imported names, also those for type checkers, with their modules."""
    texts: tuple[str, ...]
    """Short texts in it, which may name files."""


@functools.cache
def _read(content: bytes) -> _Module:
    tree = _parsed(content)
    bound = {
        alias.asname or alias.name: f"{node.module}.{alias.name}"
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
    }
    nodes = [*_executed(tree)]
    texts = [node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)]
    files = (text for text in texts if re.fullmatch(r"\w[\w./-]*", text))
    return _Module(tuple(dict.fromkeys(_names(nodes))), bound, tuple(dict.fromkeys(files)))


def _executed(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes of a module except those only for type checkers."""
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        yield node
        for_checkers = isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)
        waiting += node.orelse if for_checkers else [*ast.iter_child_nodes(node)]


def _names(nodes: Iterable[ast.AST]) -> Iterator[str]:
    """Yield dotted names: of imports, attributes of the package, in strings, in "-m equipoise", at the head of f-strings."""
    for node in nodes:
        match node:
            case ast.Import():
                yield from (alias.name for alias in node.names)
            case ast.ImportFrom(module=str(module)):
                yield from (f"{module}.{alias.name}" for alias in node.names)
            case ast.Attribute(value=ast.Name(id="equipoise"), attr=name):
                yield f"equipoise.{name}"
            case ast.Constant(value=str(text)):
                yield from _MODULE.findall(text)
            case ast.JoinedStr(values=[ast.Constant(value=str(text)), *_]) if re.fullmatch(
                r"equipoise(\.\w+)+\.", text
            ):
                yield f"{text}*"
            case ast.List(elts=parts):
                words = [part.value if isinstance(part, ast.Constant) else None for part in parts]
                if "-m" in words and "equipoise" in words:
                    yield "equipoise.__main__"
            case _:
                pass


@functools.cache
def _parsed(content: bytes) -> ast.Module:
    """Parse a module, and remove docstrings and other string statements."""
    tree = ast.parse(content)
    for node in ast.walk(tree):
        if isinstance(body := getattr(node, "body", None), list):
            node.body = [one for one in body if not (isinstance(one, ast.Expr) and isinstance(one.value, ast.Constant))]
    return tree


@functools.cache
def _digest(path: str, content: bytes) -> str:
    return _hash(_shape(_parsed(content)).encode() if path.endswith(".py") else content)


def _shape(node: object) -> str:
    """Return the syntax as text without empty fields, in which versions of Python differ."""
    if isinstance(node, ast.AST):
        fields = (f"{name}={_shape(value)}" for name, value in ast.iter_fields(node) if value not in (None, []))
        return f"{type(node).__name__}({','.join(fields)})"
    return f"[{','.join(map(_shape, node))}]" if isinstance(node, list) else repr(node)


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:_HASH_LENGTH]
