"""Covers what equipoise uses of mujoco.rollout."""

import numpy as np
from numpy.typing import NDArray

from . import MjData, MjModel

_FloatArray = NDArray[np.float64]

class Rollout:
    def __init__(self, *, nthread: int | None = None) -> None: ...
    def rollout(
        self,
        model: MjModel,
        data: MjData,
        initial_state: _FloatArray,
        control: _FloatArray | None = None,
        *,
        control_spec: int = ...,
        initial_warmstart: _FloatArray | None = None,
    ) -> tuple[_FloatArray, _FloatArray]: ...
    def close(self) -> None: ...
