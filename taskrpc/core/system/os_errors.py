"""The system's texts for errors, the same on each system where a test or a page quotes them."""

from __future__ import annotations

import errno
import os
import sys

_REFUSED = 1225  # Windows' ERROR_CONNECTION_REFUSED, from asyncio's proactor


def reason_of(error: OSError) -> str:
    """Return the system's text for an error; frequent errors have the same text everywhere."""
    if sys.platform == "win32":
        if error.winerror == _REFUSED or error.errno == errno.ECONNREFUSED:
            return "Connection refused"
        if error.errno == errno.EADDRINUSE:
            return "Address already in use"
        if error.errno == errno.ENOENT:
            return "No such file or directory"
        return error.strerror or str(error)
    else:  # asyncio puts its own sentences into `strerror`
        return os.strerror(error.errno) if error.errno else str(error)
