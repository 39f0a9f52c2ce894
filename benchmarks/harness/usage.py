"""CPU time and memory of processes: this one everywhere, others on Linux."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable
from pathlib import Path

_PROCESS_CLOCK = 2
"""Linux: which clock of another process is meant, in the low bits of a clock id."""


def cpu_time(helpers: Iterable[int] = ()) -> float:
    """Seconds of CPU that this process and its helpers have used."""
    return time.process_time() + sum(_cpu_time_of(pid) for pid in helpers)


def _cpu_time_of(pid: int) -> float:
    if sys.platform != "linux":
        return 0.0
    return time.clock_gettime((~pid << 3) | _PROCESS_CLOCK)


def memory() -> int:
    """Bytes of private memory of this process; 0 if the system does not report them.

    Without pages of files: how they are shared changes with every process that comes and goes.
    """
    if sys.platform == "linux":
        for line in Path("/proc/self/smaps_rollup").read_text().splitlines():
            if line.startswith("Anonymous:"):
                return int(line.split()[1]) * 1024
    return 0
