"""Helpers for tests of the command line."""

import os
import pty
import sys
from concurrent.futures import ThreadPoolExecutor

from equipoise.cli import main


def fails(capsys, code, *arguments):
    """Run a command, expect the exit code and one error line on stderr, and return the line."""
    assert main(list(arguments)) == code
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err
    lines = [line for line in captured.err.splitlines() if line.startswith("error: ")]
    assert len(lines) == 1
    return lines[0]


def at_a_terminal(arguments, until, answer, monkeypatch):
    """Run a command whose operator reads its stderr until a text, and types an answer.

    Returns:
        stderr up to the text, stderr after the answer, and the exit code.
    """
    keyboard, terminal = pty.openpty()
    printed, error = os.pipe()

    def operate():
        with open(printed, encoding="utf-8") as read:
            asked = ""
            while until not in asked and (more := read.read(1)):
                asked += more
            os.write(keyboard, f"{answer}\n".encode())
            return asked, read.read()

    with ThreadPoolExecutor() as pool, open(terminal, encoding="utf-8") as stdin:
        operator = pool.submit(operate)
        with open(error, "w", encoding="utf-8") as stderr, monkeypatch.context() as patched:
            patched.setattr(sys, "stdin", stdin)
            patched.setattr(sys, "stderr", stderr)
            code = main(arguments)
        asked, rest = operator.result()
    os.close(keyboard)
    return asked, rest, code
