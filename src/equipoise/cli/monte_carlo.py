"""`equipoise monte-carlo`."""

from __future__ import annotations

import json as json_module
from collections.abc import Generator
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import arg

from equipoise.cli.flags import Described, Duration, File, Robot, described, seconds
from equipoise.errors import SettingsError
from equipoise.robot.description import RobotDescription

Count = Annotated[int | None, arg(metavar="N", help_behavior_hint="")]
Names = Annotated[str, arg(metavar="NAME,NAME", help_behavior_hint="")]


def monte_carlo(
    robot: Robot = "unitree_a1",
    *,
    trials: int = 100,
    methods: Annotated[str, arg(metavar="NAME,NAME")] = "paper",
    noise: Literal["ideal", "realistic"] = "realistic",
    only: Names = "",
    vary_noise: bool = False,
    payload: Annotated[str, arg(metavar="random|none|M,X,Y,Z")] = "random",
    spread: float = 0.0,
    scale_error: Annotated[float | None, arg(metavar="FRACTION", help_behavior_hint="")] = None,
    tolerance: float = 0.005,
    budget: Duration = None,
    timestep: Annotated[float | None, arg(metavar="SECONDS", help_behavior_hint="")] = None,
    seed: int = 0,
    workers: Count = None,
    executor: Literal["process", "dask"] = "process",
    scheduler: Annotated[str | None, arg(metavar="tcp://HOST:PORT", help_behavior_hint="")] = None,
    description_file: File = None,
    description: Described = RobotDescription(),  # noqa: B008
    out: File = None,
    pictures: bool = True,
    json: bool = False,
    quiet: bool = False,
    debug: bool = False,
) -> None:
    """Calibrate many simulated robots, each with its own payload and sensor errors, and count how near the truth they come.

    A trial's number and the seed decide everything about it, whatever runs it and when. Rows reach the disk as they come;
    run the same command again after an interruption, or with more trials, and it goes on.

    Example: equipoise monte-carlo go2 --trials 200 --methods paper,precise --out runs/mc-go2

    Args:
        trials: How many.
        methods: precise, paper, static; each calibrates every drawn robot.
        noise: Sensor and actuator errors of the simulated robots.
        only: Error sources that are kept, as joint_zero,imu_tilt; default all.
        vary_noise: Draw the size of each error source, from 0 to twice its usual one: shows what each one costs.
        payload: random: 5 to 30 % of the base's mass on its back; none; or MASS,X,Y,Z as in 'calibrate'.
        spread: Random robots: link lengths, masses and the base's centre of mass vary by this fraction.
        scale_error: precise: each robot is weighed, with this relative error; 0.005 is half a percent.
        tolerance: paper: the search ends when the bounds of the offset are this close [m].
        budget: precise: robot time, as 60s or 2min.
        timestep: Of the simulation [s]; default 1 ms for paper and static, 0.5 ms for precise.
        seed: Of everything drawn.
        workers: Processes; default one for each core.
        executor: process: on this machine; dask: on the cluster of --scheduler.
        scheduler: Address of a Dask scheduler.
        description_file: TOML file with a robot description; flags win over it.
        out: Folder of the study; default runs/monte-carlo-ROBOT.
        pictures: PNG pictures are drawn unless this is given.
        json: Print the summary as one JSON object and nothing else on stdout.
        quiet: No progress.
        debug: Show a traceback if something goes wrong.
    """
    from equipoise.pictures.files import save_figures
    from equipoise.pictures.study import draw_slopes, draw_study
    from equipoise.study.runner import run_study
    from equipoise.study.statistics import slopes, summarize
    from equipoise.study.study import Study
    from equipoise.study.summary import save_summary, summary_markdown, summary_table
    from equipoise.terminal.study import StudyLine, print_study

    study = Study(
        robot, names(methods), noise, names(only), vary_noise, payload, spread, scale_error, tolerance, seconds(budget),
        timestep, seed, described(description_file, description),
    )  # fmt: skip
    folder = out or Path("runs") / f"monte-carlo-{Path(robot).stem}"
    with _executor(executor, scheduler) as (pool, threads), StudyLine(quiet or json) as line:
        rows = run_study(study, trials, folder, pool, threads if workers is None else workers, line.update)
    summaries = summarize(rows)
    # Sizes that vary with the robots alone vary together: nothing tells their shares apart.
    costs = [slope for method in study.methods if vary_noise for slope in slopes(rows, method)]
    table = summary_table(study, summaries, costs)
    files = save_summary(folder, table, summary_markdown(study, summaries, costs))
    if pictures:
        figures = {"errors.png": draw_study(rows, summaries, f"{robot}: {trials} simulated calibrations")}
        figures |= {f"sources-{m}.png": draw_slopes(rows, costs, m) for m in {slope.method for slope in costs}}
        files += save_figures(figures, folder)
    if json:
        print(json_module.dumps(table, indent=2))
    else:
        print_study(summaries, costs, files)


def names(text: str) -> Any:
    """The words between commas."""
    return tuple(word.strip() for word in text.split(",") if word.strip())


@contextmanager
def _executor(kind: str, scheduler: str | None) -> Generator[tuple[Executor | None, int | None]]:
    from equipoise.study.executors import dask_cluster

    if (kind == "dask") != (scheduler is not None):
        raise SettingsError("--executor dask and --scheduler tcp://HOST:PORT go together")
    if scheduler is None:
        yield None, None
        return
    with dask_cluster(scheduler) as cluster:
        yield cluster
