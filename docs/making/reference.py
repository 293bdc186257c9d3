"""Reference tables out of the code: flags of every verb, keys of the robot configuration, names of the Python package."""

import dataclasses
import inspect
import io
import os
import re
from contextlib import redirect_stdout, suppress
from itertools import pairwise
from unittest.mock import patch

import equipoise
from equipoise import RobotDescription, cli, errors

_VARIANTS = (
    ("calibrate", "--method", "paper"),
    ("calibrate", "--method", "motors"),
    ("calibrate", "--platform", "unitree-go2"),
)
"""Choices that have flags of their own."""
_WIDTH = "110"  # the flags' help is one column, as tyro sets it
_STYLE = re.compile(r"\x1b\[[0-9;]*m")
_RULE = re.compile(r" *-{20,}")
_FLAG = re.compile(r"^  (\S(?:.*?\S)?)(?: {2,}(.*))?$")


def flags() -> str:
    """Return every verb with its flags; a group of flags that an earlier verb has refers to that verb."""
    verbs = [(name,) for name in cli.VERBS]
    verbs += [(group, verb) for group in cli.GROUPS for verb in cli.GROUPS[group]]
    first: dict[str, str] = {}
    written = []
    for words in verbs:
        verb, anchor = " ".join(words), "-".join(words)
        about, groups = help_of(*words)
        written.append(f"## `{verb}` {{ #{anchor} }}\n\n{about}\n")
        for title, rows in groups.items():
            table = _table(title, rows)
            known = first.setdefault(table, anchor)
            written.append(f"{table if known == anchor else f'{title}: see [`{known}`](#{known}).'}\n")
    for verb, *choice in _VARIANTS:
        usual = {flag.split()[0] for rows in help_of(verb)[1].values() for flag in rows}
        _, groups = help_of(verb, *choice)
        rows = {flag: text for rows in groups.values() for flag, text in rows.items() if flag.split()[0] not in usual}
        title = f"`{verb} {' '.join(choice)}`"
        written.append(f"## {title}\n\n{_table(f'In addition to [`{verb}`](#{verb})', rows)}\n")
    return "\n".join(written)


def _table(title: str, rows: dict[str, str]) -> str:
    return "\n".join([f"| {title} | |", "|---|---|", *(f"| `{flag}` | {text} |" for flag, text in rows.items())])


def help_of(*words: str) -> tuple[str, dict[str, dict[str, str]]]:
    """Return what a verb's help states above its flags, and its flags with their help by the title of their group."""
    printed = io.StringIO()
    with patch.dict(os.environ, {"COLUMNS": _WIDTH}), redirect_stdout(printed), suppress(SystemExit):
        cli.main([*words, "--help"])
    lines = [_STYLE.sub("", line).rstrip() for line in printed.getvalue().splitlines()]
    heads = [at - 1 for at, line in enumerate(lines) if _RULE.fullmatch(line) and not lines[at - 1].startswith("  ")]
    groups = {}
    for begin, end in pairwise([*heads, len(lines)]):
        behind = max(at for at in range(begin, end) if _RULE.fullmatch(lines[at])) + 1
        rows: list[list[str]] = []
        for line in lines[behind:end]:
            if found := _FLAG.match(line):
                rows.append([found[1].replace("|", "/"), found[2] or ""])
            elif line and rows:
                rows[-1][1] += f" {line.strip()}"
        if rows := [row for row in rows if "--help" not in row[0]]:
            groups[lines[begin].strip().capitalize()] = {flag: _escaped(text.strip()) for flag, text in rows}
    usage, _, rest = "\n".join(lines[: heads[0]] if heads else lines).partition("\n\n")
    about, _, examples = rest.partition("\nExample")
    commands = [usage.removeprefix("usage: "), *re.findall(r"equipoise .*", examples)]
    shown = "\n".join(f"    {line}" for line in commands)
    return f"{_escaped(about.strip())}\n\n{shown}\n", groups


def verbs() -> str:
    """Return the table of the verbs and their purposes, as `equipoise --help` lists them."""
    purposes = {verb: words for verb, (_, words) in cli.VERBS.items()}
    for group in cli.GROUPS:
        purposes |= {f"{group} {verb}": words for verb, (_, words) in cli.GROUPS[group].items()}
    rows = [f"| [`{verb}`](#{verb.replace(' ', '-')}) | {_escaped(words)} |" for verb, words in purposes.items()]
    return "\n".join(["| verb | purpose |", "|---|---|", *rows])


def exit_codes() -> str:
    """Return the table of the exit codes that exceptions set, with the first sentence of each exception's docstring."""
    rows = {}
    for error in vars(errors).values():
        if isinstance(error, type) and "exit_code" in vars(error) and error.exit_code > 1:
            rows[error.exit_code] = f"| {error.exit_code} | `{error.__name__}` | {_first_sentence(error)} |"
    return "\n".join(["| exit code | exception | meaning |", "|---|---|---|", *(rows[code] for code in sorted(rows))])


def _first_sentence(documented: type) -> str:
    return _escaped(" ".join(inspect.getdoc(documented).partition("\n\n")[0].split()))


def robot_keys() -> str:
    """Return the table of the robot configuration's keys: name, type, meaning."""
    meanings = re.findall(
        r"^    (\w+): (.*(?:\n        +\S.*)*)", inspect.getdoc(RobotDescription).partition("Attributes:")[2], re.MULTILINE
    )  # fmt: skip
    types = {field.name: _type(str(field.type)) for field in dataclasses.fields(RobotDescription)}
    rows = [f"| `{name}` | {types[name]} | {_escaped(' '.join(text.split()))} |" for name, text in meanings]
    assert len(rows) == len(types), "a key of the robot configuration has no meaning in its docstring"
    return "\n".join(["| key | type | meaning |", "|---|---|---|", *rows])


def _type(name: str) -> str:
    """Return the TOML type of a field."""
    kinds = {"tuple[float, float, float]": "three numbers", "float": "number", "str": "text", "Forward": "text"}
    if name.startswith("dict"):
        value = name.removeprefix("dict[str, ").removesuffix("]")
        return f"table of {'two numbers' if value.startswith('tuple') else kinds[value] + 's'}"
    return kinds[name.removesuffix(" | None")]


def public_names() -> str:
    """Return a mkdocstrings directive for each stable name, in the groups of their packages."""
    packages: dict[str, list[str]] = {}
    for name in equipoise.__all__:
        if not name.startswith("__"):
            home = equipoise._HOME[name]
            packages.setdefault(home.partition(".")[0], []).append(f"equipoise.{home}.{name}")
    written = []
    for package, names in sorted(packages.items()):
        written.append(f"## `equipoise.{package}`\n")
        written += [f"::: {name}\n    options: {{heading_level: 3}}\n" for name in sorted(names)]
    return "\n".join(written)


def _escaped(text: str) -> str:
    """Return text of help as Markdown takes it."""
    return re.sub(r"([|*_\[\]<])", lambda found: f"&#{ord(found[1])};", text)
