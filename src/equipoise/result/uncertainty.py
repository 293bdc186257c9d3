"""Sources of the uncertainty of a result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from equipoise.conventions import FloatArray
from equipoise.robot.inertial import COMPONENTS


@dataclass(frozen=True, eq=False)
class UncertaintySource:
    """One source of uncertainty.

    Attributes:
        name: name of the error source.
        shares: (10,) fractions of the variances of the whole robot's parameters, in the order of COMPONENTS; they sum to
            one over all sources.
        remedy: action that reduces this uncertainty.
    """

    name: str
    shares: FloatArray
    remedy: str

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        shares = {name: round(float(share), 4) for name, share in zip(COMPONENTS, self.shares, strict=True)}
        return {"source": self.name, "variance_shares": shares, "remedy": self.remedy}

    @classmethod
    def from_dict(cls, table: Mapping[str, Any]) -> UncertaintySource:
        """Return a source from its JSON form."""
        shares = table["variance_shares"]
        return cls(table["source"], np.array([shares[name] for name in COMPONENTS]), table["remedy"])
