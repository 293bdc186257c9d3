"""The verbs that move nothing: plan, estimate, robots, audit."""

from __future__ import annotations

import dataclasses
import json as json_module
import warnings
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from equipoise.cli.flags import Described, Duration, File, Kilograms, Robot, Verbose, load, seconds
from equipoise.robot.description import RobotDescription


def plan(
    robot: Robot = "unitree_a1",
    *,
    budget: Duration = None,
    sway: bool = True,
    description_file: File = None,
    description: Described = RobotDescription(),  # noqa: B008
    json: bool = False,
    debug: bool = False,
) -> None:
    """Show what 'calibrate --method precise' would do, and how accurate it would be. Moves nothing, needs no simulator.

    Example: equipoise plan go2 --budget 60s

    Args:
        budget: Robot time, as 60s, 120s or 2min; default 120 s on an A1, more on larger robots.
        sway: As in 'calibrate'.
        description_file: TOML file with a robot description; flags win over it.
        json: Print one JSON object and nothing else on stdout.
        debug: Show a traceback if something goes wrong.
    """
    from equipoise.experiments.precise_routine import PreciseSettings, plan_ahead
    from equipoise.outputs.terminal import print_plan
    from equipoise.robot.stance import nominal_stance

    model = load(robot, description_file, description)
    result = plan_ahead(model, nominal_stance(model), PreciseSettings(seconds(budget), sway=sway))
    if json:
        print(json_module.dumps({"schema": "equipoise.plan/1", "robot": model.name, **result.to_dict()}, indent=2))
    else:
        print_plan(model.name, result)


def estimate(
    run: Annotated[Positional[Path], arg(metavar="RUN", help="Run folder of a calibration.")],
    *,
    feet: Annotated[Literal["measured", "commanded"] | None, arg(help_behavior_hint="")] = None,
    mass: Kilograms = None,
    mass_sd: Kilograms = None,
    json: bool = False,
    verbose: Verbose = False,
    debug: bool = False,
) -> None:
    """Estimate again from a run's recordings, without a robot or a simulator.

    Example: equipoise estimate runs/go2 --mass 16.2 --mass-sd 0.05

    Args:
        feet: As in 'calibrate'; default as in the run.
        mass: As in 'calibrate'; default as in the run.
        mass_sd: As in 'calibrate'; default as in the run.
        json: Print the result as one JSON object and nothing else on stdout.
        verbose: Show how long each stage of the estimate took.
        debug: Show a traceback if something goes wrong.
    """
    from equipoise.outputs.terminal import print_calibration
    from equipoise.run_folder import RunFolder

    folder = RunFolder.open(run)
    settings = folder.settings()
    precise = settings.precise
    if mass is not None or mass_sd is not None:
        precise = dataclasses.replace(precise, mass=mass or precise.mass, mass_sd=mass_sd)
    result = folder.estimate(dataclasses.replace(settings, feet=feet or settings.feet, precise=precise))
    if json:
        print(result.to_json(), end="")
    else:
        print_calibration(result, [], verbose)


def robots(*, json: bool = False, debug: bool = False) -> None:
    """List the robots known by name, with mass, legs and where each model comes from.

    Example: equipoise robots --json

    Args:
        json: Print one JSON object and nothing else on stdout.
        debug: Show a traceback if something goes wrong.
    """
    from equipoise.outputs.terminal import print_robots
    from equipoise.robot.catalog import describe_catalog

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        rows = describe_catalog()
    if json:
        print(json_module.dumps({"schema": "equipoise.robots/1", "robots": [dataclasses.asdict(row) for row in rows]}))
    else:
        print_robots(rows)


def audit(
    robot: Robot,
    *,
    description_file: File = None,
    description: Described = RobotDescription(),  # noqa: B008
    json: bool = False,
    debug: bool = False,
) -> None:
    """Check the inertial parameters in a robot's model file. Needs no simulator.

    Example: equipoise audit my_robot.urdf

    Args:
        description_file: TOML file with a robot description; flags win over it.
        json: Print one JSON object and nothing else on stdout.
        debug: Show a traceback if something goes wrong.
    """
    from equipoise.outputs.terminal import print_audit
    from equipoise.robot.audit import audit as run

    with warnings.catch_warnings():  # the audit says what was repaired
        warnings.simplefilter("ignore")
        model = load(robot, description_file, description)
    result = run(model)
    if json:
        print(json_module.dumps({"schema": "equipoise.audit/1", **result.to_dict()}, indent=2))
    else:
        print_audit(result)
