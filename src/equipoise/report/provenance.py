"""Tables of settings and provenance, from which a run can be reproduced."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from equipoise.figures.blocks import Block, DataTable, number
from equipoise.result.calibration import Calibration


def facts(result: Calibration) -> dict[str, str]:
    """Return version, model, seed, time and platform, by name."""
    model = {f"model {name.replace('_', ' ')}": str(value) for name, value in result.model.items()}
    repairs = () if result.robot_model is None else result.robot_model.source.repairs
    feet = {"feet": result.feet} if result.feet else {}
    about = {"robot": result.robot, "method": result.method, **feet}
    repaired = {"model repairs": "; ".join(repairs)} if repairs else {}
    return {**about, **dict(_flat(result.provenance, "none")), **model, **repaired}


def provenance_blocks(result: Calibration) -> list[Block]:
    """Return facts, settings and the stance as tables."""
    blocks: list[Block] = [DataTable("Provenance of this run", ["fact", "value"], list(facts(result).items()))]
    joints = {
        "Joint positions of the nominal stance": result.joint_position,
        "Locked joints, part of the base": result.locked_joints,
    }
    for title, positions in joints.items():
        rows = [[name, number(q, 1, ".4f"), number(float(np.degrees(q)), 1, ".2f")] for name, q in positions.items()]
        blocks += [DataTable(title, ["joint", "|[rad]", "|[deg]"], rows, folded=True)] if rows else []
    settings = dict(_flat(result.settings, "not given"))
    return [*blocks, DataTable("All settings", ["setting", "value"], list(settings.items()), folded=True)]


def _flat(table_of: Mapping[str, Any], nothing: str, above: str = "") -> Iterator[tuple[str, str]]:
    """Yield dotted names and values as text; None becomes `nothing`."""
    for name, value in table_of.items():
        if isinstance(value, Mapping):
            yield from _flat(value, nothing, f"{above}{name}.")  # pyright: ignore[reportUnknownArgumentType]
        else:
            yield f"{above}{name}", nothing if value is None else str(value)
