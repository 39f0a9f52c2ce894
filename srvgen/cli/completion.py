"""Completion with the TAB key, by argcomplete (extra `completion`).

The shell code of `taskrpc shell` runs a command with `_ARGCOMPLETE` in its environment. The
command then prints what may stand at the cursor and exits. A command imports this module only
then: it would slow down every other run.
"""

from __future__ import annotations

import argparse
import glob
import os
import re
import sys
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NoReturn, TypeAlias

Finder: TypeAlias = "Callable[[argparse.Namespace], Iterable[str]]"
"""Finds what an argument may be, given the options and arguments before it."""

_SET_BY_SHELL = "COMP_LINE", "COMP_POINT", "_ARGCOMPLETE"
"""The line, the place of the cursor in it, and the number of words that name the command."""

_FILES = frozenset("DIR FILE FOLDER OUT PATH SRC".split())
"""Words in the metavar of an argument that takes files or folders."""


def words_before() -> list[str]:
    """The words between the command and the word at the cursor."""
    from argcomplete.lexers import split_line

    line, point, start = (os.environ[name] for name in _SET_BY_SHELL)
    before: list[str] = split_line(line, int(point))[3]
    return before[int(start) :]


def complete(parser: argparse.ArgumentParser, finders: Mapping[str, Finder]) -> NoReturn:
    """Print what may stand at the cursor, and exit.

    `finders` has a function for each `dest` of an argument whose names are known.
    """
    import argcomplete

    def candidates(
        *, prefix: str, action: argparse.Action, parsed_args: argparse.Namespace, **_: Any
    ) -> list[str]:
        found: list[str] = []
        if finder := finders.get(action.dest):
            try:
                found = sorted(set(finder(parsed_args)))
            except Exception:  # after a key press, no candidates are better than a traceback
                found = []
        if _FILES.intersection(re.findall("[A-Z]+", str(action.metavar))):
            found += _files(prefix)
        return found

    completer: Any = candidates  # argcomplete's own type is a class; it takes any callable
    argcomplete.autocomplete(
        parser, always_complete_options=False, default_completer=completer, exit_method=sys.exit
    )
    sys.exit()


def interfaces(_: argparse.Namespace) -> list[str]:
    """Every interface that can be found."""
    from ..files.search import Search

    search = Search()
    return [name for package in search.packages() for name in search.interfaces(package)]


def _files(prefix: str) -> list[str]:
    """Files and folders that begin so, folders with a slash."""
    found = glob.glob(glob.escape(prefix) + "*")
    return [f"{path}/" if os.path.isdir(path) else path for path in sorted(found)]
