"""The limit of open files and connections of a process."""

from __future__ import annotations

import contextlib

_UNKNOWN = 8192
"""Used if the system has no such limit or does not report it."""


def open_files() -> int:
    """Raise this process's limit of open files to the maximum; returns the limit."""
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        soft, most = resource.getrlimit(resource.RLIMIT_NOFILE)
        if most != resource.RLIM_INFINITY:
            resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
            return most
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (_UNKNOWN, most))
            soft = _UNKNOWN
        return soft
    return _UNKNOWN
