"""Verbs that list robots and platforms. This module starts fast: it imports no NumPy and no flag parser."""

from __future__ import annotations

import dataclasses
import json as json_module


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
    from equipoise.terminal.lists import print_platforms

    rows = describe_platforms()
    if json:
        table = [dataclasses.asdict(row) for row in rows]
        print(json_module.dumps({"schema": "equipoise.platforms/1", "platforms": table}, indent=2))
    else:
        print_platforms(rows)
