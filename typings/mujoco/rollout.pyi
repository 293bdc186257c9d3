"""Covers what equipoise uses of mujoco.rollout."""

import numpy as np
from numpy.typing import NDArray

from . import MjData, MjModel

_FloatArray = NDArray[np.float64]

class Rollout:
    def __init__(self, *, nthread: int | None = None) -> None: ...
    def rollout(
        self,
        model: list[MjModel],
        data: list[MjData],
        initial_state: _FloatArray,
        control: _FloatArray | None = None,
        *,
        control_spec: int = ...,
        skip_checks: bool = False,
        nstep: int | None = None,
        initial_warmstart: _FloatArray | None = None,
        state: _FloatArray | None = None,
        sensordata: _FloatArray | None = None,
    ) -> tuple[_FloatArray, _FloatArray]: ...
    def close(self) -> None: ...
