"""`equipoise lab monte-carlo`."""

from __future__ import annotations

import json as json_module
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import arg

from equipoise.cli.flags import (
    ContactsName,
    Count,
    Described,
    File,
    Flag,
    NoiseName,
    Output,
    Robot,
    RobotFlags,
    WithEffects,
    WithoutEffects,
    described,
)
from equipoise.cli.methods import refuse_flags_of_other_methods
from equipoise.cli.settings import Verb, chosen, flags_class, read_flags, seconds, settings_of, shaped
from equipoise.errors import SettingsError

DEFAULT_METHODS = "paper"
Names = Annotated[str, arg(metavar="NAME,NAME", help_behavior_hint="")]


@dataclass(frozen=True)
class DrawnFlags:
    """The simulated robots.

    Attributes:
        only: Effects that are kept, as joint_zero,imu_tilt; default all.
        vary_noise: Draw the size of each effect, from 0 to twice its usual one: shows what each one costs.
        payload: random: 5 to 30 % of the base's mass on its back; none; or MASS,X,Y,Z as in 'calibrate'.
        spread: Random robots: link lengths, masses and the base's centre of mass vary by this fraction.
        scale_error: Each robot is weighed, with this relative error, for the methods that use it; 0.005 is half a percent.
        timestep: Of the simulation [s]; default what each method takes: 1 ms for paper and static, 0.5 ms for precise.
        seed: Of everything drawn.
    """

    noise: NoiseName = "realistic"
    effects: WithEffects = ()
    without: WithoutEffects = ()
    contacts: ContactsName = "own"
    only: Names = ""
    vary_noise: Flag = False
    payload: Annotated[str, arg(metavar="random|none|M,X,Y,Z")] = "random"
    spread: float = 0.0
    scale_error: Annotated[float | None, arg(metavar="FRACTION", help_behavior_hint="")] = None
    timestep: Annotated[float | None, arg(metavar="SECONDS", help_behavior_hint="")] = None
    seed: int = 0


@dataclass(frozen=True)
class StudyOutput(Output):
    """What is written and shown.

    Attributes:
        out: Folder of the study; default runs/monte-carlo-ROBOT.
        report: Leave out the page summary.html.
    """

    out: File = None
    report: Flag = True


def monte_carlo(
    robot: Robot = "unitree_a1",
    *,
    trials: Annotated[int, arg(metavar="N")] = 100,
    workers: Count = None,
    executor: Literal["process", "dask"] = "process",
    scheduler: Annotated[str | None, arg(metavar="tcp://HOST:PORT", help_behavior_hint="")] = None,
    trial_limit: Annotated[str, arg(metavar="TIME")] = "30min",
    method: Any = None,
    simulation: DrawnFlags = DrawnFlags(),
    description: Described = RobotFlags(),  # noqa: B008
    output: StudyOutput = StudyOutput(),
) -> None:
    """Calibrate many simulated robots, each with its own payload and sensor errors, and count how near the truth they come.

    A trial's number and the seed decide everything about it, whatever runs it and when. Rows reach the disk as they come;
    run the same command again after an interruption, or with more trials, and it goes on.

    Example: equipoise lab monte-carlo go2 --trials 200 --methods paper,precise --out runs/mc-go2

    Args:
        trials: How many.
        workers: Processes; default one for each core.
        executor: process: on this machine; dask: on the cluster of --scheduler.
        scheduler: Address of a Dask scheduler.
        trial_limit: Longest time that a trial may take; then its process is ended, and the trial is lost if that was twice.
    """
    from equipoise.lab.pages.markdown import markdown
    from equipoise.lab.pages.study import study_page
    from equipoise.lab.study.runner import run_study
    from equipoise.lab.study.statistics import slopes, summarize
    from equipoise.lab.study.study import Study
    from equipoise.lab.study.summary import save_summary, summary_table
    from equipoise.lab.terminal.study import StudyLine, print_study
    from equipoise.method.table import method_named
    from equipoise.report.page import save_page
    from equipoise.simulation.effects import read_effects, read_names

    drawn: dict[str, Any] = {**vars(simulation), "only": names(simulation.only)}
    drawn |= {"effects": read_effects(simulation.effects), "without": read_names(simulation.without)}
    methods = tuple(read_flags(method_named(name), method) for name in names(method.methods))
    study = Study(robot, methods, **drawn, description=described(description))
    folder = output.out or Path("runs") / f"monte-carlo-{Path(robot).stem}"
    with _executor(executor, scheduler) as (pool, count), StudyLine(output.silent) as line:
        at_once = count if workers is None else workers
        rows = run_study(study, trials, folder, pool, at_once, line.update, seconds(trial_limit, "trial-limit") or 0.0)
    summaries = summarize(rows)
    # Sizes that vary with the robots alone vary together: nothing tells their shares apart.
    costs = [slope for used in study.methods if study.vary_noise for slope in slopes(rows, used.name)]
    table = summary_table(study, summaries, costs)
    page = study_page(study, rows, summaries, costs)
    files = save_summary(folder, table, markdown(page, "summary.html"))
    if output.report:
        files.append(save_page(page, folder / "summary.html"))
    if output.json:
        print(json_module.dumps(table, indent=2))
    else:
        print_study(page, files)


def monte_carlo_for(arguments: Sequence[str]) -> Verb:
    """`monte-carlo` with the flags of the methods that are asked for; raises SettingsError."""
    from equipoise.method.table import METHODS, method_named

    asked = chosen(arguments, "--methods", DEFAULT_METHODS)
    settings = [setting for name in names(asked) for setting in settings_of(method_named(name))]
    words = f"Each calibrates every drawn robot, of {', '.join(METHODS)}. Flags of a method: --methods NAME --help."
    kind = Annotated[str, arg(metavar="NAME,NAME", help=words)]
    flags = flags_class("MethodFlags", "What calibrates.", settings, [("methods", kind, DEFAULT_METHODS)])
    verb = shaped(monte_carlo, method=flags)
    refuse_flags_of_other_methods(verb, arguments, f"--methods {asked}")
    return verb


def names(text: str) -> tuple[str, ...]:
    """The words between commas."""
    return tuple(word.strip() for word in text.split(",") if word.strip())


@contextmanager
def _executor(kind: str, scheduler: str | None) -> Generator[tuple[Executor | None, Callable[[], int] | None]]:
    from equipoise.lab.study.executors import dask_cluster

    if (kind == "dask") != (scheduler is not None):
        raise SettingsError("--executor dask and --scheduler tcp://HOST:PORT go together")
    if scheduler is None:
        yield None, None
        return
    with dask_cluster(scheduler) as cluster:
        yield cluster
