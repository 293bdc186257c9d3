"""The blocks of all evidence."""

from __future__ import annotations

from collections.abc import Callable

from equipoise.precise.blocks.block import ResidualBlock
from equipoise.precise.blocks.leg_swing import LegSwingBlock
from equipoise.precise.blocks.level import LevelBlock
from equipoise.precise.blocks.planted import PlantedBlock
from equipoise.precise.blocks.tilt import TiltBlock
from equipoise.precise.blocks.torque import TorqueBlock
from equipoise.precise.measurements.evidence import RunEvidence
from equipoise.precise.measurements.leg_motion import LegChains
from equipoise.precise.parameters import Unknowns

BLOCKS: tuple[Callable[[Unknowns, LegChains, RunEvidence], ResidualBlock | None], ...] = (
    TiltBlock.of,
    LevelBlock.of,
    PlantedBlock.of,
    TorqueBlock.of,
    LegSwingBlock.of,
)
"""Makers of the blocks; a maker gives None where there is no evidence of its kind."""
