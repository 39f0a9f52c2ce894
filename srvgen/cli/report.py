"""Collects and prints the problems of a `srvgen` command, and decides its exit code."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from itertools import groupby
from pathlib import Path

from ..definitions import limits
from ..errors import SHOWN, DefinitionError, DefinitionWarning, as_text, looked_in
from ..files.dependencies import problems_of


class Report:
    """Collects problems, prints each once in the order of the files, and has the exit code."""

    def __init__(self, *, as_json: bool) -> None:
        self.exit_code = 0
        self._as_json = as_json
        self._problems: dict[tuple[str, int, int, str], DefinitionError] = {}
        self._names: dict[str, str] = {}  # the path as the user wrote it, by resolved path

    @property
    def warnings(self) -> int:
        """The number of warnings."""
        return sum(isinstance(one, DefinitionWarning) for one in self._problems.values())

    def remember(self, path: Path) -> None:
        """Use the path as the user wrote it in all messages about this file."""
        self._names.setdefault(str(path.resolve()), str(path))

    def error(self, error: DefinitionError) -> None:
        """Add all problems of an error; the command fails."""
        self.exit_code = 1
        for problem in problems_of(error):
            self._add(problem)

    def warn(self, warnings: Iterable[DefinitionWarning]) -> None:
        """Add warnings; the command does not fail because of them."""
        for warning in warnings:
            self._add(warning)

    def failure(self, sentence: str) -> None:
        """Print why the command fails if no definition is the reason."""
        self.exit_code = 1
        print(sentence, file=sys.stderr)

    def finish(self) -> None:
        """Print all problems on stderr, file by file and line by line."""
        # Problems without a file come last.
        ordered = [self._problems[key] for key in sorted(self._problems, key=_order)]
        shown: list[DefinitionError] = []
        for path, group in groupby(ordered, key=lambda one: one.path):
            of_file = list(group)
            shown += of_file[:SHOWN]
            for problem in of_file[:SHOWN]:
                self._print(problem)
            if len(of_file) > SHOWN:
                least = "at least " if len(of_file) >= limits.PROBLEMS else ""
                more = f"and {least}{len(of_file) - SHOWN} more problems"
                self._print(DefinitionError(more, path=path))
        for line in [] if self._as_json else looked_in(shown):
            print(line, file=sys.stderr)

    def _add(self, problem: DefinitionError) -> None:
        problem.path = self._names.get(problem.path, problem.path)
        key = (problem.path, problem.line, problem.column, problem.message)
        self._problems.setdefault(key, problem)

    def _print(self, problem: DefinitionError) -> None:
        print(self._json(problem) if self._as_json else as_text(problem), file=sys.stderr)

    def _json(self, problem: DefinitionError) -> str:
        import json

        fields = ("message", "path", "line", "column", "hint", "looked_in")
        given = {name: value for name in fields if (value := getattr(problem, name))}
        return json.dumps({problem.level: type(problem).__name__, **given})


def _order(key: tuple[str, int, int, str]) -> tuple[bool, str, int, int, str]:
    return not key[0], *key
