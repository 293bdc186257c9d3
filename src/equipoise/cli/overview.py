"""What is shown to somebody who names no verb, and to a shell that wants to complete one."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from contextlib import redirect_stdout
from typing import Annotated, Any, Literal

from tyro.conf import Positional, arg

Shell = Annotated[Positional[Literal["bash", "zsh"]], arg(metavar="SHELL", help="Which shell.")]


def print_overview(verbs: Mapping[Callable[..., Any], str]) -> None:
    """What can be done, a line each."""
    from rich.console import Console

    console = Console(highlight=False)
    console.print("What your quadruped weighs, where its centre of mass is and how hard it is to turn.\n")
    console.print("  equipoise calibrate                  try it: a simulated Unitree A1")
    console.print("  equipoise calibrate my_robot.urdf    yours, simulated")
    console.print("  equipoise platforms                  yours, on its own feet\n")
    for verb, words in verbs.items():
        console.print(f"  [bold]{verb.__name__.replace('_', '-'):<12}[/bold]  {words}")
    console.print("\n'equipoise VERB --help' says more.")


def completion(shell: Shell, *, debug: bool = False) -> int:
    """Print a script with which a shell completes verbs and flags.

    Example: equipoise completion bash > ~/.local/share/bash-completion/completions/equipoise
             equipoise completion zsh > ~/.zfunc/_equipoise

    Args:
        debug: Show a traceback if something goes wrong.
    """
    from equipoise.cli import main

    written = io.StringIO()
    with redirect_stdout(written):
        code = main(["--tyro-print-completion", shell])
    for line in written.getvalue().splitlines():
        # A shell takes each line of a description for another word to offer.
        print(line.replace("\\n", " ") if line.startswith("COMPLETION_SPEC = ") else line)
    return code
