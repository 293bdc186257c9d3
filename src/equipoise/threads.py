"""Limit of NumPy's linear algebra to one thread in every process of equipoise.

The matrices are small, so the threads of BLAS only spin while they wait. They double the processor time and disturb the
control loop.
"""

from __future__ import annotations

from collections.abc import Mapping

_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
ONE_THREAD: dict[str, str] = dict.fromkeys(_VARIABLES, "1")
"""Environment variables that limit every BLAS of NumPy; NumPy reads them on import."""


def default_threads(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the variables that limit BLAS to one thread; empty if the environment sets any of them."""
    return {} if environment.keys() & ONE_THREAD.keys() else ONE_THREAD
