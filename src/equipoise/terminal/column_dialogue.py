"""Reading a log that is not ours, with a dialogue about which column of a table is which."""

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

_HOW = """Enter reads it so. A line changes it: gyro.x = "wx"; gyro.x = "" leaves a column
out; units.gyro = "deg/s"; rate = 500 if there is no time. Ctrl-C ends."""


def read_as_told(
    path: Path, model: RobotModel, topics: Topics, joint_map: Path | None, columns: Columns | None,
    span: tuple[float | None, float | None], asking: bool, tables: Sequence[Path] = (),
) -> Log:  # fmt: skip
    """A log, by what the flags say of it.

    Args:
        asking: whether the operator may be asked which column of a table is which, at a terminal.
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
    """What somebody makes of a proposal.

    Raises:
        ColumnsError: the standard input is closed.
    """
    _tell(f"{error.what}:\n\n{error.proposal}\n{_HOW}")
    columns = Columns.from_text(error.proposal, "the proposal")
    answer = "?"
    while answer or columns.of_table(error.names).missing():
        answer = _answer("columns> ", error)
        try:
            line = Columns.from_text(answer, "what you wrote")
            changed = columns.with_changes(line)
            changed.check(error.names, "the table")
        except SettingsError as wrong:
            _tell(str(wrong))
            continue
        for loser in columns.losers(line):
            _tell(f"{loser} has no column now: {columns.names[loser]!r} was its")
        columns = changed
        missing = columns.of_table(error.names).missing()
        if missing:
            _tell(f"still missing: {', '.join(missing)}")
    _offer_to_save(columns, error)
    return columns


def _offer_to_save(columns: Columns, error: ColumnsError) -> None:
    while answer := _answer("save it for --columns as (Enter: not at all)> ", error):
        try:
            write_file(Path(answer).expanduser(), columns.to_toml(), "the columns ")
        except OutputError as wrong:
            _tell(str(wrong))
            continue
        _tell(f"saved: {answer}")
        return


def _answer(prompt: str, error: ColumnsError) -> str:
    print(prompt, end="", file=sys.stderr, flush=True)
    line = sys.stdin.readline()
    if not line:
        raise error
    return line.strip()


def _tell(words: str) -> None:
    print(words, file=sys.stderr, flush=True)
