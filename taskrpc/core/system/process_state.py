"""What the system knows about a process: whether it is stopped, has ended, has a file open."""

from __future__ import annotations

import contextlib
import os
import sys

STOPPED = "is stopped, as by Ctrl-Z"
"""What messages say of a process for which `is_stopped` is true."""


def has_open(pid: int, file: os.stat_result) -> bool:
    """Return whether a process has a file open; where the system does not tell, True for any pid.

    Linux tells it for this user's processes. Ids below 1 mean groups of processes: always False.
    """
    if pid < 1 or not os.path.isdir("/proc/self/fd"):
        return pid > 0
    folder = f"/proc/{pid}/fd"
    with contextlib.suppress(OSError):  # it has ended, or belongs to another user
        for descriptor in os.listdir(folder):
            with contextlib.suppress(OSError):  # it may have just been closed
                if os.path.samestat(os.stat(f"{folder}/{descriptor}"), file):
                    return True
    return False


def ignores_end(pid: int) -> bool:
    """Return whether a process ignores the signal to end; only Linux tells it."""
    import signal

    with contextlib.suppress(OSError, ValueError), open(f"/proc/{pid}/status", "rb") as file:
        for line in file:
            if line.startswith(b"SigIgn:"):
                return bool(int(line.split()[1], 16) >> (signal.SIGTERM - 1) & 1)
    return False


def is_stopped(pid: int) -> bool:
    """Return whether a process is stopped, for example by Ctrl-Z, until it gets SIGCONT."""
    return _state_of(pid) in (b"T", b"t")


def has_ended(pid: int) -> bool:
    """Return whether no program runs as this process any more. Windows does not tell: always True.

    A process that has ended keeps its id until its parent has read its exit status.
    """
    return _state_of(pid) in (b"", b"Z", b"X")


def _state_of(pid: int) -> bytes:
    """Return the letter of a process's state as in ps(1), b"" if there is no such process."""
    status = f"/proc/{pid}/stat"
    with contextlib.suppress(OSError):  # it may have just ended
        if os.path.exists(status):
            with open(status, "rb") as file:
                return file.read().rpartition(b")")[2].split()[0]
        if sys.platform != "win32":
            import subprocess

            command = ["ps", "-o", "stat=", "-p", str(pid)]
            return subprocess.run(command, capture_output=True, check=False).stdout.strip()[:1]
    return b""
