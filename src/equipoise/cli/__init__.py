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
from equipoise.cli.delta import delta
from equipoise.cli.export import export
from equipoise.cli.inspect import audit, estimate, plan, robots
from equipoise.cli.monte_carlo import monte_carlo
from equipoise.cli.overview import completion, print_overview
from equipoise.cli.report import report
from equipoise.cli.reproduce import reproduce
from equipoise.cli.robot import doctor, platforms, record
from equipoise.cli.view import view
from equipoise.errors import EquipoiseError, OutputError

INTERRUPTED = 130
VERBS = {
    calibrate: "find mass, centre of mass and inertia; simulated or on the robot",
    plan: "what 'calibrate' would do, and how accurate it would be",
    estimate: "estimate again from a run, or from a log that is not ours",
    view: "watch a run in the browser, live or again",
    report: "a page to read and to show: a run, or several compared",
    export: "write the result into the file that your controller reads",
    delta: "what was added between two calibrations",
    doctor: "look at a robot without moving it",
    record: "log a robot's sensors without moving it",
    balance: "stand on two feet in simulation, to test a centre of mass",
    monte_carlo: "calibrate many simulated robots, and count how near they come",
    reproduce: "the paper's table, figures and rates, made again",
    robots: "robots known by name",
    platforms: "simulators and robots, how they start, their settings",
    audit: "what speaks against the inertias in a model file",
    completion: "a script with which a shell completes verbs and flags",
}
"""What can be done, and what it is in a few words."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if arguments == ["--version"]:
        print(f"equipoise {_version.__version__}")
        return 0
    if arguments in ([], ["-h"], ["--help"]):
        print_overview(VERBS)
        return 0 if arguments else 2
    app = tyro.extras.SubcommandApp()
    for verb in VERBS:
        app.command(verb)
    with _warnings_on_stderr("--quiet" in arguments):
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
def _warnings_on_stderr(quiet: bool) -> Generator[None]:
    def show(message: Warning | str, category: type[Warning], *_: Any) -> None:
        print(f"warning: {message}", file=sys.stderr)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore" if quiet else "default")
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
