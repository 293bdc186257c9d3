"""The command line: one function per verb, and what they print. No arithmetic."""

from __future__ import annotations

import json as json_module
import os
import sys
import traceback
import warnings
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import tyro
from tyro.conf import OmitArgPrefixes

from equipoise import _version
from equipoise.cli.balance import balance
from equipoise.cli.calibrate import calibrate
from equipoise.cli.inspect import audit, estimate, plan, robots
from equipoise.cli.monte_carlo import monte_carlo
from equipoise.cli.reproduce import reproduce
from equipoise.cli.robot import doctor, platforms, record
from equipoise.cli.view import view
from equipoise.errors import EquipoiseError, OutputError

INTERRUPTED = 130
VERBS = (
    calibrate, plan, estimate, view, doctor, record, balance, monte_carlo, reproduce, robots, platforms, audit,
)  # fmt: skip


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if arguments == ["--version"]:
        print(f"equipoise {_version.__version__}")
        return 0
    app = tyro.extras.SubcommandApp()
    for verb in VERBS:
        app.command(verb)
    with _warnings_on_stderr():
        try:
            code = app.cli(
                args=arguments,
                prog="equipoise",
                description="What your quadruped weighs, where its centre of mass is and how hard it is to turn.",
                config=(OmitArgPrefixes, tyro.conf.FlagCreatePairsOff),
            )
        except SystemExit as stop:  # tyro has printed its help, or what is wrong with the flags
            code = int(stop.code or 0)
            return _failed("UsageError", "the flags cannot be used; see stderr", code, arguments) if code else 0
        except EquipoiseError as error:
            if "--debug" in arguments:
                traceback.print_exc()
            print(f"error: {error}", file=sys.stderr)
            return _failed(type(error).__name__, str(error), error.exit_code, arguments, error.details)
        except KeyboardInterrupt:
            print("interrupted", file=sys.stderr)
            return _failed("Interrupted", "interrupted", INTERRUPTED, arguments)
        except BrokenPipeError:  # the reader, `head` say, has seen enough
            sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 - flushed when Python exits
            return 0
        except OSError as error:
            print(f"error: cannot write: {error}", file=sys.stderr)
            return OutputError.exit_code
    return int(code or 0)  # verbs that judge return an exit code


@contextmanager
def _warnings_on_stderr() -> Generator[None]:
    def show(message: Warning | str, category: type[Warning], *_: Any) -> None:
        print(f"warning: {message}", file=sys.stderr)

    with warnings.catch_warnings():
        warnings.simplefilter("default")
        warnings.showwarning = show  # pyright: ignore[reportAttributeAccessIssue]
        yield


def _failed(
    kind: str, message: str, code: int, arguments: Sequence[str], details: Mapping[str, Any] | None = None
) -> int:
    """With --json an error is an object too. Returns the exit code."""
    if "--json" in arguments:
        table = {"type": kind, "message": message, "exit_code": code, **(details or {})}
        print(json_module.dumps({"schema": "equipoise.error/1", "error": table}))
    return code
