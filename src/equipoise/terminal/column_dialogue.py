"""Reader for logs of other programs, with a dialogue that assigns the columns of a table."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from equipoise.errors import ColumnsError, OutputError, SettingsError
from equipoise.logs.joint_names import read_joint_map
from equipoise.logs.raw_log import Log
from equipoise.logs.reader import read_log
from equipoise.logs.tables.column_names import Columns
from equipoise.logs.topics import Topics
from equipoise.robot.model import RobotModel
from equipoise.user_file import write_file

_HELP = """Press Enter to accept, or type a line to change it: gyro.x = "wx";
gyro.x = "" to omit a column; units.gyro = "deg/s"; rate = 500 without times.
Ctrl-C ends."""


def read_with_dialogue(
    path: Path, model: RobotModel, topics: Topics, joint_map: Path | None, columns: Columns | None,
    span: tuple[float | None, float | None], asking: bool, tables: Sequence[Path] = (),
) -> Log:  # fmt: skip
    """Return a log, read with the given topics, joint map and columns.

    Args:
        asking: true to ask the operator at a terminal to assign the columns of a table.
        tables: further tables of the same run.
    """
    joints = None if joint_map is None else read_joint_map(joint_map)
    try:
        return read_log(path, model, topics, joints, span, columns, tables)
    except ColumnsError as error:
        if not (asking and sys.stdin.isatty() and sys.stderr.isatty()):
            raise
        return read_log(path, model, topics, joints, span, ask_columns(error), tables)


def ask_columns(error: ColumnsError) -> Columns:
    """Return the columns after the operator has confirmed or changed the proposal.

    Raises:
        ColumnsError: the standard input is closed.
    """
    _print(f"{error.what}:\n\n{error.proposal}\n{_HELP}")
    columns = Columns.from_text(error.proposal, "the proposal")
    answer = "?"
    while answer or columns.of_table(error.names).missing():
        answer = _answer("columns> ", error)
        try:
            line = Columns.from_text(answer, "your line")
            changed = columns.with_changes(line)
            changed.check(error.names, "the table")
        except SettingsError as wrong:
            _print(str(wrong))
            continue
        for loser in columns.losers(line):
            _print(f"{loser} no longer has a column; it was {columns.names[loser]!r}")
        columns = changed
        missing = columns.of_table(error.names).missing()
        if missing:
            _print(f"still missing: {', '.join(missing)}")
    _offer_to_save(columns, error)
    return columns


def _offer_to_save(columns: Columns, error: ColumnsError) -> None:
    while answer := _answer("file to save it for --columns (Enter: do not save)> ", error):
        try:
            write_file(Path(answer).expanduser(), columns.to_toml(), "the columns ")
        except OutputError as wrong:
            _print(str(wrong))
            continue
        _print(f"saved: {answer}")
        return


def _answer(prompt: str, error: ColumnsError) -> str:
    print(prompt, end="", file=sys.stderr, flush=True)
    line = sys.stdin.readline()
    if not line:
        raise error
    return line.strip()


def _print(words: str) -> None:
    print(words, file=sys.stderr, flush=True)
