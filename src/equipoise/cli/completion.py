"""`equipoise completion`."""

from __future__ import annotations

import io
from contextlib import redirect_stdout
from typing import Annotated, Literal

from tyro.conf import Positional, arg

Shell = Annotated[Positional[Literal["bash", "zsh"]], arg(metavar="SHELL", help="Which shell.")]


def completion(shell: Shell) -> int:
    """Print a script with which a shell completes verbs and flags.

    Example: equipoise completion bash > ~/.local/share/bash-completion/completions/equipoise
             equipoise completion zsh > ~/.zfunc/_equipoise
    """
    from equipoise.cli import main

    written = io.StringIO()
    with redirect_stdout(written):
        code = main(["--tyro-print-completion", shell])
    for line in written.getvalue().splitlines():
        # A shell takes each line of a description for another word to offer.
        print(line.replace("\\n", " ") if line.startswith("COMPLETION_SPEC = ") else line)
    return code
