"""ROS domains for tests: two processes of pytest never use the same one at a time."""

from __future__ import annotations

import itertools
import tempfile
from functools import cache
from pathlib import Path

_BLOCK = 10
"""Domains of one process. A test's programs may need some seconds to leave their domain."""
_LAST = 100
"""The ports of higher domains are in the range that Linux gives to any program."""


@cache
def own_domains() -> itertools.cycle[int]:
    """Take a block of domains that no other process uses; the operating system frees it later."""
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
        return itertools.cycle(range(first, first + _BLOCK))
    raise AssertionError("the loop above does not end")


_locks: list[object] = []
