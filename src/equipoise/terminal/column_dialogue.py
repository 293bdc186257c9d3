"""Reader for logs of other programs, with a dialogue that assigns the columns of a table."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from equipoise.errors import OutputError, RecordingError, SettingsError
from equipoise.logs.joint_names import read_joint_map
from equipoise.logs.raw_log import Log
from equipoise.logs.reader import read_log
from equipoise.logs.tables.column_names import ColumnProposal, Columns
from equipoise.logs.topics import Topics
from equipoise.robot.model import RobotModel
from equipoise.user_file import write_file

_HELP = """Press Enter to accept, or type a line to change it: gyro.x = "wx";
gyro.x = "" to omit a column; units.gyro = "deg/s"; rate = 500 without times.
Ctrl-C ends."""


def read_with_dialogue(
    path: Path, model: RobotModel, topics: Topics, joint_map: Path | None, columns: Columns | None,
    span: tuple[float | None, float | None], asking: bool, tables: Sequence[Path] = (),
    standing: bool = False,
) -> Log:  # fmt: skip
    """Return a log, read with the given topics, joint map and columns.

    Args:
        asking: true to ask the operator at a terminal to assign the columns of a table.
        tables: further tables of the same run.
        standing: true for a log of a standing robot.
    """
    joints = None if joint_map is None else read_joint_map(joint_map)
    try:
        return read_log(path, model, topics, joints, span, columns, tables, standing)
    except RecordingError as error:
        proposal = error.report
        if not (isinstance(proposal, ColumnProposal) and asking and sys.stdin.isatty() and sys.stderr.isatty()):
            raise
        return read_log(path, model, topics, joints, span, ask_columns(proposal, standing), tables, standing)


def ask_columns(proposal: ColumnProposal, standing: bool = False) -> Columns:
    """Return the columns after the operator has confirmed or changed the proposal.

    Raises:
        RecordingError: the standard input is closed.
    """
    _print(f"{proposal.what}:\n\n{proposal.text}\n{_HELP}")
    columns = Columns.from_text(proposal.text, "the proposal")
    answer = "?"
    while answer or columns.of_table(proposal.names).missing(standing):
        answer = _answer("columns> ", proposal)
        try:
            line = Columns.from_text(answer, "your line")
            changed = columns.with_changes(line)
            changed.check(proposal.names, "the table")
        except SettingsError as wrong:
            _print(str(wrong))
            continue
        for loser in columns.losers(line):
            _print(f"{loser} no longer has a column; it was {columns.names[loser]!r}")
        columns = changed
        missing = columns.of_table(proposal.names).missing(standing)
        if missing:
            _print(f"still missing: {', '.join(missing)}")
    _offer_to_save(columns, proposal)
    return columns


def _offer_to_save(columns: Columns, proposal: ColumnProposal) -> None:
    while answer := _answer("file to save it for --columns (Enter: do not save)> ", proposal):
        try:
            write_file(Path(answer).expanduser(), columns.to_toml(), "the columns ")
        except OutputError as wrong:
            _print(str(wrong))
            continue
        _print(f"saved: {answer}")
        return


def _answer(prompt: str, proposal: ColumnProposal) -> str:
    print(prompt, end="", file=sys.stderr, flush=True)
    line = sys.stdin.readline()
    if not line:
        raise proposal.error()
    return line.strip()


def _print(words: str) -> None:
    print(words, file=sys.stderr, flush=True)
