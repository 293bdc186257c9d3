"""Physics engines by name: MuJoCo, and those that the lab and other packages add with an entry point.

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
"""An engine is a function of the robot, its stance, its drawn errors, the payload, the posture that it starts in, the time
step and the contacts, which returns a `Simulation`; see `equipoise.simulation.simulation.build`."""
