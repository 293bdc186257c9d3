"""`equipoise lab reproduce`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from equipoise.cli.flags import Count, Output
from equipoise.errors import SettingsError


def reproduce(
    *,
    out: Annotated[Path, arg(metavar="PATH")] = Path("reproduction"),
    trials: Annotated[int, arg(metavar="N")] = 200,
    bayesian_trials: Annotated[int, arg(metavar="N")] = 40,
    workers: Count = None,
    output: Output,
) -> None:
    """Reproduce the paper's results: Table I, Fig. 3, the Monte Carlo rate, and the
    effect of joint errors.

    This takes some minutes. To resume after an interruption, repeat the command.

    Example: equipoise lab reproduce --out reproduction

    Args:
        out: Folder for README.md and report.html.
        trials: Number of trials of the paper's method.
        bayesian_trials: Number of trials of the Bayesian method, which takes ten times as long.
        workers: Number of processes; default one per core.
    """
    from equipoise.lab.pages.reproduction_page import reproduction_page, save_reproduction
    from equipoise.lab.study.reproduction import reproduce as run
    from equipoise.lab.terminal import StudyLine, print_study

    if trials < 1 or bayesian_trials < 1:
        raise SettingsError(f"the number of trials is {min(trials, bayesian_trials)}; it must be at least 1")
    with StudyLine(output.silent) as line:
        done = run(out / "studies", trials, bayesian_trials, workers, line.update_study)
    page = reproduction_page(done)
    files = save_reproduction(page, out)
    table = {"schema": "equipoise.reproduction/1", "files": [str(file) for file in files]}
    output.write(table, lambda: print_study(page, files))
