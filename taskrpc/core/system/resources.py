"""What the system gives this process: descriptors and memory."""

from __future__ import annotations

import sys
from functools import cache

_NO_LIMIT = 2**20


def descriptor_limit() -> int:
    """Return how many files and sockets this process may have open at a time."""
    if sys.platform == "win32" or sys.platform == "emscripten":
        return _NO_LIMIT
    else:
        import resource

        soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
        return _NO_LIMIT if soft == resource.RLIM_INFINITY else soft


@cache
def keep_freed_memory(size: int) -> None:
    """Let Linux's allocator keep the freed memory of messages of up to `size` bytes.

    Normally the allocator returns the top of its heap to the system when more than 128 KiB are
    free, and requests it again a moment later; for a message of 1 MiB, that takes most of the time.
    After it has once freed a block of this size, it keeps twice as much. The block costs nothing,
    because nothing is written to it. Source: M_MMAP_THRESHOLD in mallopt(3). Other systems'
    allocators need no such hint.
    """
    if sys.platform == "linux":
        bytes(size)
