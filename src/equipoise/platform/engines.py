"""Physics engines by name: MuJoCo, and the entry points of the lab and other packages.

[project.entry-points."equipoise.engines"]
dart = "equipoise.lab.dart.engine:build"
"""

from __future__ import annotations

from types import FunctionType
from typing import Any

from equipoise.plugins import Table

ENGINES: Table[Any] = Table(
    "engine", "equipoise.engines", FunctionType, {"mujoco": "equipoise.simulation.simulation:build"}
)
"""Engines: functions of the robot, its stance, its drawn errors, the payload, the initial posture, the time step and the
contacts that return a `Simulation`; see `equipoise.simulation.simulation.build`."""
