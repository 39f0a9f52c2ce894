"""Text files of users: maps, parameters, requests, lists of names."""

from __future__ import annotations

import errno
import os

_LONGEST_TEXT = 16 * 2**20  # bytes


def read_text(path: str | os.PathLike[str], encoding: str = "utf-8") -> str:
    """Return the text of a user's file of at most 16 MiB, with `\\n` as line breaks.

    The file may be a pipe, such as a shell's `<(command)`. Raises OSError, and UnicodeDecodeError.
    """
    import io

    with open(path, "rb") as file:
        data = file.read(_LONGEST_TEXT + 1)
    if len(data) > _LONGEST_TEXT:
        raise OSError(errno.EFBIG, os.strerror(errno.EFBIG), os.fspath(path))
    return io.TextIOWrapper(io.BytesIO(data), encoding).read()
