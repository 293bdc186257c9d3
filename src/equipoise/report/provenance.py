"""Settings and provenance: what it takes to make the same page again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from equipoise.report.blocks import Block, table
from equipoise.report.numbers import tell
from equipoise.result.calibration import Calibration


def facts(result: Calibration) -> dict[str, str]:
    """Version, model, stance, seed, time, platform, by name."""
    model = {f"model {name.replace('_', ' ')}": str(value) for name, value in result.model.items()}
    repairs = () if result.robot_model is None else result.robot_model.source.repairs
    about = {
        "robot": result.robot,
        "method": result.method,
        **({"feet": result.feet} if result.feet else {}),
    }
    repaired = {"model repairs": "; ".join(repairs)} if repairs else {}
    return {**about, **dict(_flat(result.provenance, "none")), **model, **repaired}


def provenance_blocks(result: Calibration) -> list[Block]:
    """Facts, settings and the stance as tables."""
    settings = dict(
        _flat({name: value for name, value in result.settings.items() if name not in _others(result)}, "not given")
    )
    stance, held = (
        [[name, tell(q, ".4f"), tell(float(np.degrees(q)), ".2f")] for name, q in joints.items()]
        for joints in (result.joint_position, result.held)
    )
    return [
        table(["what", "value"], [list(row) for row in facts(result).items()], "Where this comes from"),
        table(["joint", "|[rad]", "|[deg]"], stance, "Joint positions of the stance that all refers to", folded=True),
        *_held_table(held),
        table(["setting", "value"], [list(row) for row in settings.items()], "All settings", folded=True),
    ]


def _held_table(rows: list[list[str]]) -> list[Block]:
    about = "Joints that were held still, and count as part of the base"
    return [table(["joint", "|[rad]", "|[deg]"], rows, about)] if rows else []


def _others(result: Calibration) -> set[str]:
    """Settings of what the run did not do: older results hold those of all methods."""
    if "precise" not in result.settings:
        return set()
    did = {"com_search": result.support_lines, "feet": result.support_lines, "sway": result.sways,
           "precise": result.has_intervals}  # fmt: skip
    return {name for name, what in did.items() if not what}


def _flat(table_of: Mapping[str, Any], nothing: str, above: str = "") -> Iterator[tuple[str, str]]:
    """Names with dots, values as text; what is None as the word for nothing."""
    for name, value in table_of.items():
        if isinstance(value, Mapping):
            yield from _flat(value, nothing, f"{above}{name}.")  # pyright: ignore[reportUnknownArgumentType]
        else:
            yield f"{above}{name}", nothing if value is None else str(value)
