"""The machine and the date of a benchmark, without names of hosts or users."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from benchmarks.harness.processes import ROOT


def about() -> dict[str, Any]:
    """Date, machine and the state of the code."""
    return {
        "date": time.strftime("%Y-%m-%d", time.gmtime()),
        "cpu": _cpu(),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.release()}",
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        "commit": _commit(),
        "load": _load(),
    }


def _load() -> float:
    """Runnable processes, on average over the last minute; 0 if unknown."""
    return round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else 0.0


class Others:
    """Measures how much of the machine other programs use, from its creation on."""

    def __init__(self) -> None:
        self._before = _busy_beside_us()
        self._began = time.monotonic()

    def cores(self) -> float | None:
        """The cores that other programs kept busy on average; None if unknown.

        The processes that this one has started count as ours once they have ended.
        """
        now = _busy_beside_us()
        if self._before is None or now is None:
            return None
        return round(max(0.0, now - self._before) / (time.monotonic() - self._began), 2)


def _busy_beside_us() -> float | None:
    """Seconds that cores have worked for others, the machine's host included."""
    if sys.platform != "linux":
        return None
    return _busy(Path("/proc/stat").read_text(), os.sysconf("SC_CLK_TCK")) - sum(os.times()[:4])


def _busy(stat: str, ticks_a_second: int) -> float:
    """Seconds that all cores have worked; `stat` is the text of /proc/stat."""
    ticks = [int(each) for each in stat.partition("\n")[0].split()[1:9]]
    user, nice, system, _idle, _waiting, irq, softirq, steal = ticks
    return (user + nice + system + irq + softirq + steal) / ticks_a_second


def _cpu() -> str:
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _commit() -> str:
    """The commit that was measured, "" outside of a checkout."""
    command = ["git", "describe", "--always", "--dirty"]
    try:
        found = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    except OSError:
        return ""
    return found.stdout.strip()
