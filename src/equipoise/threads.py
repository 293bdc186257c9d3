"""How many threads NumPy's linear algebra takes: one, in every process of ours.

Its matrices here are small: the threads that BLAS keeps for large ones have nothing to do but to wait, which they do
spinning. They double the time that a processor is busy, and stand beside a loop that has to be on time.
"""

from __future__ import annotations

from collections.abc import Mapping

_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
ONE_THREAD: dict[str, str] = dict.fromkeys(_VARIABLES, "1")
"""Of an environment, what limits every BLAS that NumPy comes with; it is read when NumPy is imported."""


def unless_told(environment: Mapping[str, str]) -> dict[str, str]:
    """What an environment lacks for one thread; nothing where somebody has said how many, by whichever variable."""
    return {} if environment.keys() & ONE_THREAD.keys() else ONE_THREAD
