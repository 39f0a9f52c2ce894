"""Command lines as texts: their words, and the program that Windows would start."""

from __future__ import annotations

import shlex
import shutil
import sys
from collections.abc import Mapping, Sequence


def split_words(line: str) -> list[str]:
    """Split a command line as a shell does; raises ValueError if a quote is not closed."""
    lexer = shlex.shlex(line, posix=True, punctuation_chars=False)
    lexer.whitespace_split, lexer.commenters = True, ""
    if sys.platform == "win32":
        lexer.escape = ""  # there the backslash separates folders
    return list(lexer)


def startable(command: Sequence[str], env: Mapping[str, str] | None) -> list[str]:
    """Return a command that the system can start: Windows itself finds no `.cmd` and no `.bat`.

    Args:
        env: the program's environment, None for that of this process.
    """
    if sys.platform == "win32" and command:
        path = None if env is None else env.get("PATH")
        command = [shutil.which(command[0], path=path) or command[0], *command[1:]]
    return list(command)
