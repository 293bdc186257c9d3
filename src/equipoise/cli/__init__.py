"""Command line: one function per verb. No arithmetic."""

from __future__ import annotations

import importlib
import os
import sys
import warnings
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from equipoise import _version
from equipoise.errors import EquipoiseError, OutputError, SettingsError, did_you_mean
from equipoise.plugins import Table

INTERRUPTED = 130
VERBS = {
    "calibrate": ("equipoise.cli.calibrate", "estimate mass, centre of mass and inertia, simulated or real"),
    "plan": ("equipoise.cli.inspect", "show the motions of 'calibrate' and predict its accuracy"),
    "estimate": ("equipoise.cli.inspect", "estimate again from a run, or from a log of another program"),
    "diagnose": ("equipoise.cli.inspect", "find why a robot leans: joint, IMU, payload or torque"),
    "view": ("equipoise.cli.view", "show a run or a log in the Rerun viewer"),
    "report": ("equipoise.cli.report", "write a page about one run, or a page that compares several"),
    "export": ("equipoise.cli.export", "write the result into the file that your controller reads"),
    "compare": ("equipoise.cli.compare", "compute the payload that was added between two calibrations"),
    "payload": ("equipoise.cli.payload", "measure the payload on the robot in half a minute"),
    "doctor": ("equipoise.cli.robot", "check a robot's sensors and joint map without moving it"),
    "record": ("equipoise.cli.robot", "log a robot's sensors without moving it"),
    "robots": ("equipoise.cli.overview", "list the robots that have a name"),
    "platforms": ("equipoise.cli.overview", "list simulators and robots, with their start and settings"),
    "audit": ("equipoise.cli.inspect", "check the inertias in a model file"),
}
"""Module of each verb, imported when the verb is used, and its purpose."""
GROUPS: Table[Mapping[str, tuple[str, str]]] = Table("group of verbs", "equipoise.verbs", dict, {})
"""Tables like `VERBS` from installed packages, for `equipoise GROUP VERB`. The lab is one."""


def find_verb(name: str, arguments: Sequence[str] = ()) -> Callable[..., int | None]:
    """Return the function of a verb.

    If the flags of a verb depend on its arguments, `VERB_for` returns the function.

    Args:
        name: verb, or group and verb as "lab balance".
        arguments: words that follow it.

    Raises:
        SettingsError: a flag is not allowed with --resume, which takes all settings from the run.
    """
    group, _, verb = name.rpartition(" ")
    module = importlib.import_module((GROUPS[group] if group else VERBS)[verb][0])
    function = verb.replace("-", "_")
    shape = getattr(module, f"{function}_for", None)
    found: Callable[..., int | None] = getattr(module, function) if shape is None else shape(arguments)
    return found


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if arguments == ["--version"]:
        print(f"equipoise {_version.__version__}")
        return 0
    if arguments in ([], ["-h"], ["--help"]):
        from equipoise.cli.overview import print_verbs

        groups = {group: ", ".join(GROUPS[group]) for group in GROUPS}
        print_verbs({name: words for name, (_, words) in VERBS.items()} | groups)
        return 0 if arguments else 2
    with _warnings_on_stderr("--quiet" in arguments):
        try:
            code = _run(arguments)
        except SystemExit as stop:  # tyro has printed help or an error
            code = int(stop.code or 0)
            return _failed("UsageError", "invalid flags; see stderr", code, arguments) if code else 0
        except EquipoiseError as error:
            if "--debug" in arguments:
                import traceback

                traceback.print_exc()
            print_message(f"error: {error}")
            return _failed(type(error).__name__, str(error), error.exit_code, arguments, error.details)
        except KeyboardInterrupt:
            print("interrupted", file=sys.stderr)
            return _failed("Interrupted", "interrupted", INTERRUPTED, arguments)
        except BrokenPipeError:  # the reader, such as `head`, has closed
            sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 - flushed when Python exits
            return 0
        except OSError as error:
            print_message(f"error: cannot write: {error}")
            return OutputError.exit_code
    return int(code or 0)  # None from verbs that always succeed


def _run(arguments: Sequence[str]) -> int | None:
    """Import and run the verb that the arguments name; raises SystemExit for invalid flags."""
    name, words, verbs = arguments[0], arguments[1:], VERBS
    if name not in VERBS and name in GROUPS:
        verbs = GROUPS[name]
        if not words or words[0] in ("-h", "--help"):
            from equipoise.cli.overview import print_group

            print_group(name, {verb: purpose for verb, (_, purpose) in verbs.items()})
            return 0 if words else 2
        name, words = f"{name} {words[0]}", words[1:]
    group, _, requested = name.rpartition(" ")
    if requested not in verbs:
        program = f"equipoise {group}".rstrip()
        raise SettingsError(
            f"{program} has no verb {requested!r}; {did_you_mean(requested, verbs)}'{program} --help' lists them"
        )
    from equipoise.cli.arguments import refuse_missing

    refuse_missing(name, words)
    verb = find_verb(name, words)
    if (switches := _switches(verb, words)) is not None:
        return verb(**switches)
    from equipoise.cli.parsing import parse

    chosen = getattr(sys.modules[verb.__module__], "CHOSEN", {})
    return parse(verb, words, f"equipoise {name}", chosen)()


def _switches(verb: Callable[..., Any], words: Sequence[str]) -> dict[str, bool] | None:
    """Return the flags of a verb that has only switches, without loading the parser; None for other verbs or words."""
    from inspect import signature

    parameters = signature(verb).parameters
    if any(parameter.default is not False for parameter in parameters.values()):
        return None
    return (
        dict.fromkeys((word[2:] for word in words), True) if {*words} <= {f"--{name}" for name in parameters} else None
    )


@contextmanager
def _warnings_on_stderr(quiet: bool) -> Generator[None]:
    def show(message: Warning | str, category: type[Warning], *_: Any) -> None:
        print_message(f"warning: {message}")

    with warnings.catch_warnings():
        warnings.simplefilter("ignore" if quiet else "default")
        warnings.showwarning = show  # pyright: ignore[reportAttributeAccessIssue]
        yield


def print_message(text: str) -> None:
    """Print a message on stderr, its first line wrapped at a terminal; proposals that follow stay as they are."""
    if sys.stderr.isatty():
        import shutil
        import textwrap

        first, line, others = text.partition("\n")
        width = shutil.get_terminal_size().columns
        text = textwrap.fill(first, width, break_long_words=False, break_on_hyphens=False) + line + others
    print(text, file=sys.stderr)


def _failed(
    kind: str, message: str, code: int, arguments: Sequence[str], details: Mapping[str, Any] | None = None
) -> int:
    """Print the error as an object with --json, and return the exit code."""
    import json

    from equipoise.cli.arguments import chosen

    if "--json" in arguments or chosen(arguments, "--format", "") == "json":
        table = {"type": kind, "message": message, "exit_code": code, **(details or {})}
        print(json.dumps({"schema": "equipoise.error/1", "error": table}))
    return code
