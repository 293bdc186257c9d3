"""`equipoise reproduce`."""

from __future__ import annotations

import json as json_module
from pathlib import Path

from equipoise.cli.monte_carlo import Count
from equipoise.errors import SettingsError


def reproduce(
    *,
    out: Path = Path("reproduction"),
    trials: int = 200,
    precise_trials: int = 40,
    workers: Count = None,
    json: bool = False,
    quiet: bool = False,
    debug: bool = False,
) -> None:
    """Make the paper's results again: Table I, Fig. 3, the Monte Carlo rate, and what joint errors cost.

    Takes some minutes; run it again after an interruption, and it goes on.

    Example: equipoise reproduce --out reproduction

    Args:
        out: Folder for README.md, CSV files and figures.
        trials: Of the paper's method.
        precise_trials: Of the precise method, which takes ten times as long.
        workers: Processes; default one for each core.
        json: Print one JSON object and nothing else on stdout.
        quiet: No progress.
        debug: Show a traceback if something goes wrong.
    """
    from equipoise.pictures.reproduction import markdown, save_reproduction
    from equipoise.study.reproduction import reproduce as run
    from equipoise.terminal.study import StudyLine

    if trials < 1 or precise_trials < 1:
        raise SettingsError(f"{min(trials, precise_trials)} trials are none; ask for one at least")
    with StudyLine(quiet or json) as line:
        done = run(out / "studies", trials, precise_trials, workers, line.doing)
    files = save_reproduction(done, out)
    if json:
        print(json_module.dumps({"schema": "equipoise.reproduction/1", "files": [str(file) for file in files]}))
        return
    print(markdown(done))
    print("saved: " + ", ".join(str(file) for file in files))
