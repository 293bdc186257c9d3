"""Real-time privileges of the robot process."""

from __future__ import annotations

import ctypes
import gc
import os
import sys

_PRIORITY = 50  # of 1 to 99: above user programs, below the system's own threads
_CURRENT_AND_FUTURE = 3  # of mlockall
_REMEDY = "docs/hardware/safety.md#real-time-priority explains how to grant it without root"


def claim_priority() -> bool:
    """Claim real-time scheduling for the calling thread; return whether it was granted."""
    if sys.platform != "linux":
        return False
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
    except OSError:
        return False
    return True


def claim_real_time() -> str:
    """Claim real-time scheduling and locked memory, end garbage collection; return the result in words."""
    gc.collect()
    gc.freeze()
    gc.disable()
    refused = [] if claim_priority() else ["real-time priority (SCHED_FIFO)"]
    libc = ctypes.CDLL(None, use_errno=True)
    if not hasattr(libc, "mlockall") or libc.mlockall(_CURRENT_AND_FUTURE) != 0:
        refused.append("locked memory (mlockall)")
    if refused:
        return f"not permitted: {' and '.join(refused)}; {_REMEDY}"
    return "real-time priority and locked memory"
