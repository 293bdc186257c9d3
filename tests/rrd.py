"""Reader of Rerun files."""

from dataclasses import dataclass

import numpy as np
import pytest


@dataclass(frozen=True)
class Entity:
    """Rows of one entity that have a time, in order of time, or its static rows if it has no others."""

    times: np.ndarray
    rows: list

    def column(self, name):
        """Return the values of a component, row by row."""
        return [row[name] for row in self.rows if row.get(name) is not None]


def read_rrd(path):
    """Return all entities of a file by path."""
    chunk = pytest.importorskip("rerun.chunk", reason="this rerun-sdk cannot read files: their contents were NOT TRIED")
    static, timed = {}, {}
    for piece in chunk.RrdReader(str(path)).stream():
        batch = piece.to_record_batch()
        columns = {name: batch.column(name) for name in batch.schema.names if name != "time"}
        rows = [{name: column[k].as_py() for name, column in columns.items() if ":" in name} for k in range(len(batch))]
        if "time" in batch.schema.names:
            seconds = [moment.value * 1e-9 for moment in batch.column("time")]
            timed.setdefault(str(piece.entity_path), []).extend(zip(seconds, rows, strict=True))
        else:
            static.setdefault(str(piece.entity_path), []).extend(rows)
    entities = {name: Entity(np.empty(0), rows) for name, rows in static.items()}
    for name, pairs in timed.items():
        pairs.sort(key=lambda pair: pair[0])
        entities[name] = Entity(np.array([time for time, _ in pairs]), [row for _, row in pairs])
    return entities
