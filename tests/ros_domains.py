"""ROS domains for tests: two processes of pytest never use the same one at a time."""

from __future__ import annotations

import itertools
import tempfile
import threading
import time
from collections.abc import Iterator
from functools import cache
from pathlib import Path

_BLOCK = 10
"""Domains of one process. A test's programs may need some seconds to leave their domain."""
_LAST = 100
"""The ports of higher domains are in the range that Linux gives to any program."""
MOST_LEAVING = 10
"""Fast DDS numbers the programs of a process, whatever their domains, and looks on a machine for
those up to 31: two with higher numbers never find each other. A destroyed program keeps its number
until it has left.
"""


@cache
def own_domains() -> Iterator[int]:
    """Take a block of domains that no other process uses; the operating system frees it later.

    Each `next` waits while too many programs of earlier tests are leaving their domains.
    """
    import fcntl  # the tests of ROS need Linux

    for first in itertools.cycle(range(1, _LAST, _BLOCK)):
        path = Path(tempfile.gettempdir()) / f"taskrpc-tests-ros-domain-{first}"
        file = path.open("w")
        try:
            # Wait for the last block only.
            fcntl.flock(file, fcntl.LOCK_EX | (0 if first + _BLOCK > _LAST else fcntl.LOCK_NB))
        except BlockingIOError:
            file.close()
            continue
        _locks.append(file)
        return _one_by_one(range(first, first + _BLOCK))
    raise AssertionError("the loop above does not end")


def _one_by_one(domains: range) -> Iterator[int]:
    for domain in itertools.cycle(domains):
        wait_for_those_that_leave()
        yield domain


def wait_for_those_that_leave(seconds: float = 60.0) -> None:
    """Return once few destroyed programs of this process have still to leave, or so much later."""
    ends = time.monotonic() + seconds
    while leaving() > MOST_LEAVING and time.monotonic() < ends:
        time.sleep(0.02)


def leaving() -> int:
    """Return how many programs of this process leave ROS: each does so in a thread of its own."""
    return sum(thread.name == "taskrpc ROS end" for thread in threading.enumerate())


_locks: list[object] = []
