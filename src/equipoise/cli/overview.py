"""Lists of verbs, robots and platforms. This module starts fast: it imports no NumPy and no flag parser."""

from __future__ import annotations

import json as json_module
from collections.abc import Mapping


def print_verbs(verbs: Mapping[str, str]) -> None:
    """Print a line for each verb."""
    print("Measure a quadruped's mass, centre of mass and inertia with its own sensors.\n")
    print("  equipoise calibrate                  example: a simulated Unitree A1")
    print("  equipoise calibrate my_robot.urdf    your robot, simulated")
    print("  equipoise platforms                  your robot: connection and settings\n")
    print_group("", verbs)


def print_group(group: str, verbs: Mapping[str, str]) -> None:
    """Print the verbs of a group, a line each."""
    for verb, words in verbs.items():
        print(f"  {verb:<12}  {words}")
    print(f"\n'{' '.join(filter(None, ('equipoise', group, 'VERB')))} --help' shows the flags.")


def robots(*, json: bool = False) -> None:
    """List the robots that have a name, with mass, legs and source of the model.

    Example: equipoise robots --json

    Args:
        json: Print one JSON object and nothing else on stdout.
    """
    from equipoise.json_form import to_json
    from equipoise.robot.catalog import CATALOG
    from equipoise.terminal.lists import print_robots

    if json:
        print(json_module.dumps({"schema": "equipoise.robots/1", "robots": to_json([*CATALOG.values()])}))
    else:
        print_robots(CATALOG.values())


def platforms(*, json: bool = False) -> None:
    """List the platforms: simulators and robots, how each starts, and its settings for --set KEY=VALUE.

    Example: equipoise platforms

    Args:
        json: Print one JSON object and nothing else on stdout.
    """
    from equipoise.drivers.platforms import describe_platforms
    from equipoise.json_form import fields_to_json
    from equipoise.terminal.lists import print_platforms

    rows = describe_platforms()
    if json:
        table = [fields_to_json(row) for row in rows]
        print(json_module.dumps({"schema": "equipoise.platforms/1", "platforms": table}, indent=2))
    else:
        print_platforms(rows)
