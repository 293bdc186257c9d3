"""`equipoise lab monte-carlo`."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, cast

from tyro.conf import arg
from tyro.constructors import StructConstructorSpec, StructFieldSpec

from equipoise.cli import flags
from equipoise.cli.arguments import chosen
from equipoise.cli.methods import owners, refuse_flag_of
from equipoise.cli.parsing import ChosenFlags
from equipoise.cli.setting_flags import flags_of, seconds, settings_from, spec_of
from equipoise.errors import SettingsError
from equipoise.lab.study.study import Study
from equipoise.method.method import Method
from equipoise.method.table import METHODS, method_named
from equipoise.simulation.effects import read_effects, read_names

DEFAULT_METHODS = "paper"
Names = Annotated[str, arg(metavar="NAME,NAME", help_behavior_hint="")]


@dataclass(frozen=True)
class DrawnFlags:
    """Simulated robots.

    Attributes:
        only_effects: Effects to enable, for example joint_offset,imu_tilt; default all.
        vary_effects: Draw the size of each effect, from 0 to twice its default, to measure its share of the error.
        payload: random: 5 to 30 % of the base's mass on its back; none; or MASS,X,Y,Z as in 'calibrate'.
        timestep: Time step of the simulation [s]; default 1 ms for paper and static, 0.5 ms for bayesian.
        seed: Seed of everything drawn.
    """

    sim_preset: flags.PresetName = "realistic"
    enable_effect: flags.WithEffects = ()
    disable_effect: flags.WithoutEffects = ()
    contact_model: flags.ContactModelName = "default"
    only_effects: Names = ""
    vary_effects: flags.Flag = False
    payload: Annotated[str, arg(metavar="random|none|M,X,Y,Z")] = "random"
    timestep: Annotated[float | None, arg(metavar="SECONDS", help_behavior_hint="")] = None
    seed: int = 0


def monte_carlo(
    robot: flags.Robot = "unitree_a1",
    *,
    trials: Annotated[int, arg(metavar="N")] = 100,
    workers: flags.Count = None,
    executor: Literal["process", "dask"] = "process",
    scheduler: Annotated[str | None, arg(metavar="tcp://HOST:PORT", help_behavior_hint="")] = None,
    trial_limit: Annotated[str, arg(metavar="TIME")] = "30min",
    out: flags.File = None,
    report: flags.Flag = True,
    methods: Annotated[tuple[Method, ...], arg(name="method")],
    simulation: DrawnFlags,
    description: flags.Described,
    output: flags.Output,
) -> None:
    """Calibrate many simulated robots, each with its own payload and sensor errors,
    and compute error statistics.

    The seed and a trial's number determine the trial on any machine. Rows are saved
    as they arrive: to resume an interrupted study, or to extend it with more
    trials, repeat the command.

    Example: equipoise lab monte-carlo go2 --trials 200 --methods paper,bayesian

    Args:
        trials: Number of trials.
        workers: Number of processes; default one per core.
        executor: process: on this machine; dask: on the cluster of --scheduler.
        scheduler: Address of a Dask scheduler.
        trial_limit: Time limit of a trial, after which its process is ended; a trial that is ended twice is lost.
        out: Folder of the study; default runs/monte-carlo-ROBOT.
        report: Write no page summary.html.
    """
    from equipoise.lab.pages.markdown import markdown
    from equipoise.lab.pages.study_page import study_page
    from equipoise.lab.study.runner import run_study
    from equipoise.lab.study.study_statistics import slopes, summarize
    from equipoise.lab.study.summary import save_summary, summary_table
    from equipoise.lab.terminal import StudyLine, print_study
    from equipoise.report.page import save_page

    study = Study(
        robot, methods, preset=simulation.sim_preset, effects=read_effects(simulation.enable_effect),
        disabled_effects=read_names(simulation.disable_effect), contact_model=simulation.contact_model,
        only=read_names([simulation.only_effects]), vary_effects=simulation.vary_effects, payload=simulation.payload,
        timestep=simulation.timestep, seed=simulation.seed,
        description=description,
    )  # fmt: skip
    folder = out or Path("runs") / f"monte-carlo-{Path(robot).stem}"
    with _executor(executor, scheduler) as (pool, count), StudyLine(output.silent) as line:
        at_once = count if workers is None else workers
        rows = run_study(study, trials, folder, pool, at_once, line.update, seconds(trial_limit, "trial-limit") or 0.0)
    summaries = summarize(rows)
    # Without varied effects, sizes vary with the robots only: they are correlated and have no separate slopes.
    costs = [slope for used in study.methods if study.vary_effects for slope in slopes(rows, used.name)]
    table = summary_table(study, summaries, costs)
    page = study_page(study, rows, summaries, costs)
    files = save_summary(folder, table, markdown(page, "summary.html"))
    if report:
        files.append(save_page(page, folder / "summary.html"))
    output.write(table, lambda: print_study(page, files))


def _study_flags(arguments: Sequence[str]) -> StructConstructorSpec:
    """Return `--methods` and the flags of the methods that it names; raises SettingsError."""
    text = f"Methods that calibrate every robot: {', '.join(METHODS)}. Flags of a method: --methods NAME --help."
    names = Annotated[str, arg(metavar="NAME,NAME", help=text)]
    kinds = [method_named(name) for name in read_names([chosen(arguments, "--methods", DEFAULT_METHODS)])]
    flags = [StructFieldSpec("methods", cast("Any", names), DEFAULT_METHODS)]

    def methods(values: Mapping[str, Any]) -> tuple[Method, ...]:
        return tuple(settings_from(kind, values) for kind in kinds)

    return spec_of("Methods.", [*flags, *(flag for kind in kinds for flag in flags_of(kind))], methods)


def _refuse_other(flag: str, arguments: Sequence[str]) -> None:
    refuse_flag_of(owners(flag), flag, f"--methods {chosen(arguments, '--methods', DEFAULT_METHODS)}")


CHOSEN: dict[Any, ChosenFlags] = {tuple[Method, ...]: (_study_flags, _refuse_other)}


@contextmanager
def _executor(kind: str, scheduler: str | None) -> Generator[tuple[Executor | None, Callable[[], int] | None]]:
    if (kind == "dask") != (scheduler is not None):
        raise SettingsError("--executor dask needs --scheduler tcp://HOST:PORT, and --scheduler needs --executor dask")
    if scheduler is None:
        yield None, None
        return
    from equipoise.lab.study.executors import dask_cluster

    with dask_cluster(scheduler) as cluster:
        yield cluster
