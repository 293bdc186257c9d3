"""The blocks of all evidence."""

from __future__ import annotations

from collections.abc import Callable

from equipoise.estimator.blocks.block import ResidualBlock
from equipoise.estimator.blocks.leg_swing import LegSwingBlock
from equipoise.estimator.blocks.level import LevelBlock
from equipoise.estimator.blocks.planted import PlantedBlock
from equipoise.estimator.blocks.tilt import TiltBlock
from equipoise.estimator.blocks.torque import TorqueBlock
from equipoise.estimator.measurements.evidence import RunEvidence
from equipoise.estimator.measurements.leg_motion import LegChains
from equipoise.estimator.parameters import Unknowns

BLOCKS: tuple[Callable[[Unknowns, LegChains, RunEvidence], ResidualBlock | None], ...] = (
    TiltBlock.of,
    LevelBlock.of,
    PlantedBlock.of,
    TorqueBlock.of,
    LegSwingBlock.of,
)
"""Makers of the blocks; a maker gives None where there is no evidence of its kind."""
