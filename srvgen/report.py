"""What the `srvgen` command says about problems, and the exit code that follows from it."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from pathlib import Path

from .closure import problems_of
from .errors import DefinitionError, DefinitionWarning


class Report:
    """Prints problems to stderr, each once, and knows what the exit code will be."""

    def __init__(self, *, as_json: bool) -> None:
        self.exit_code = 0
        self.warnings = 0
        self._as_json = as_json
        self._printed: set[str] = set()
        self._names: dict[str, str] = {}

    def remember(self, path: Path) -> None:
        """Call this file as the user did, whoever finds a problem in it."""
        self._names.setdefault(str(path.resolve()), str(path))

    def error(self, error: DefinitionError) -> None:
        """Tell every problem of an error; the command has failed."""
        self.exit_code = 1
        for problem in problems_of(error):
            self._print(problem)

    def warn(self, warnings: Iterable[DefinitionWarning]) -> None:
        """Tell what is suspicious; the command has not failed."""
        for warning in warnings:
            self.warnings += self._print(warning)

    def failure(self, sentence: str) -> None:
        """Say why the command has failed where no definition is to blame."""
        self.exit_code = 1
        print(sentence, file=sys.stderr)

    def _print(self, problem: DefinitionError) -> bool:
        """Print a problem and return True, unless it was printed before."""
        problem.path = self._names.get(problem.path, problem.path)
        text = self._json(problem) if self._as_json else _positioned(problem)
        if text in self._printed:
            return False
        self._printed.add(text)
        print(text, file=sys.stderr)
        return True

    def _json(self, problem: DefinitionError) -> str:
        fields = ("message", "path", "line", "column", "hint")
        given = {name: value for name in fields if (value := getattr(problem, name))}
        return json.dumps({problem.level: type(problem).__name__, **given})


def _positioned(problem: DefinitionError) -> str:
    """The problem as text; one of a whole file stands at its beginning, for editors to jump to."""
    if not problem.path or problem.line:
        return str(problem)
    placed = type(problem)
    return str(placed(problem.message, path=problem.path, line=1, column=1, hint=problem.hint))
