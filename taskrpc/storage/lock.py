"""The lock beside a file: one process uses the file, and who comes second is told which one."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

from taskrpc import platform
from taskrpc.errors import StoreError


@contextlib.contextmanager
def held(path: Path, holder: str) -> Iterator[None]:
    """Hold the lock of a file; `holder` says what uses such files.

    Raises:
        StoreError: another process has it; the text says which.
    """
    lock_path = path.resolve().with_name(path.resolve().name + ".lock")
    descriptor = platform.open_private(lock_path)
    try:
        if not platform.try_lock(descriptor):
            found = os.read(descriptor, 200).decode(errors="replace").strip()
            raise StoreError(
                f"{path} is in use by another {holder} ({found}); "
                "stop that one, or give this one another file"
            )
        lock_path.chmod(0o600)
        os.ftruncate(descriptor, 0)
        since = datetime.now().astimezone().isoformat(" ", "seconds")
        os.write(descriptor, f"pid {os.getpid()}, since {since}\n".encode())
        yield
    finally:
        os.close(descriptor)
