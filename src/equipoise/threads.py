"""Number of threads of NumPy's linear algebra: one, in every process of ours.

Its matrices here are small: the threads that BLAS keeps for large ones have nothing to do but to wait, which they do
spinning. They double the time that a processor is busy, and disturb a loop that has to be on time.
"""

from __future__ import annotations

from collections.abc import Mapping

_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
ONE_THREAD: dict[str, str] = dict.fromkeys(_VARIABLES, "1")
"""Variables that limit every BLAS that NumPy comes with; they are read when NumPy is imported."""


def unless_told(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the variables that an environment lacks for one thread; none if it sets any of them."""
    return {} if environment.keys() & ONE_THREAD.keys() else ONE_THREAD
