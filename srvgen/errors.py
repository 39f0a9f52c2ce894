"""The errors and warnings of srvgen: a message, a position, a hint and, if possible, a repair."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar, NamedTuple, Self

_LONGEST = 400
"""Characters shown of a line or a sentence."""

SHOWN = 100
"""Problems shown for one file; a longer list does not help the reader."""


class Repair(NamedTuple):
    """The only correct text for a part of a line; the offsets count from 0."""

    start: int
    end: int
    text: str


class InvalidText(Exception):
    """A word, a value or a line is not valid; the parser adds the file, the line and the column.

    Attributes:
        message: one sentence: what was expected and what was received.
        offset: the position in the checked piece of text, counted from 0.
        hint: what the author most likely meant, or "".
        repair: the correct text, if there is exactly one.
    """

    def __init__(
        self, message: str, offset: int = 0, hint: str = "", repair: Repair | None = None
    ) -> None:
        super().__init__(message)
        self.message = message
        self.offset = offset
        self.hint = hint
        self.repair = repair

    def moved(self, by: int) -> Self:
        """Shift the offsets: the checked piece of text begins at `by` in a longer text."""
        self.offset += by
        if self.repair:
            start, end, text = self.repair
            self.repair = Repair(start + by, end + by, text)
        return self


class DefinitionError(ValueError):
    """A .srv, .msg or .action text is not a valid definition, or a type cannot be found.

    The printed text is built from the attributes, so that an editor can use the position.

    Attributes:
        message: one sentence: what was expected and what was received.
        path: the file, or a name for text that is in no file.
        line, column: the position, counted from 1; 0 if the whole file is meant.
        source_line: the invalid line as it is in the file, or "".
        hint: what the author most likely meant, or "".
        repair: what `srvgen fix` writes instead (offsets in the line, and the text), or None.
        looked_in: where a missing type or package was searched, in order.
        readable: the `Definition` without its invalid lines if the parser raised this, or None.
    """

    level: ClassVar[str] = "error"
    repair: Repair | None = None
    looked_in: tuple[str, ...] = ()
    readable: object = None

    def __init__(
        self,
        message: str,
        *,
        path: str = "",
        line: int = 0,
        column: int = 0,
        source_line: str = "",
        hint: str = "",
    ) -> None:
        super().__init__(message)
        self.message = message
        self.path = path
        self.line = line
        self.column = column
        self.source_line = source_line
        self.hint = hint

    def __str__(self) -> str:
        return "\n".join([as_text(self), *looked_in([self])])

    def __reduce__(self) -> tuple[object, ...]:
        return _rebuild, (self.message, self.__dict__.copy())


class DefinitionWarning(DefinitionError):
    """A line is valid, but probably not what its author meant. It is reported, not raised."""

    level = "warning"


class DefinitionErrors(DefinitionError):
    """Several problems of one file; `problems` has them in order."""

    def __init__(self, problems: list[DefinitionError]) -> None:
        first = problems[0]
        super().__init__(
            first.message,
            path=first.path,
            line=first.line,
            column=first.column,
            source_line=first.source_line,
            hint=first.hint,
        )
        self.problems = problems

    def __str__(self) -> str:
        lines = [as_text(problem) for problem in self.problems[:SHOWN]]
        if len(self.problems) > SHOWN:
            lines.append(f"and {len(self.problems) - SHOWN} more problems")
        return "\n".join([*lines, *looked_in(self.problems)])

    def __reduce__(self) -> tuple[object, ...]:
        return DefinitionErrors, (self.problems,)


def as_text(problem: DefinitionError) -> str:
    """One problem as it is printed, without the places that were searched."""
    where = ":".join(str(part) for part in (problem.path, problem.line, problem.column) if part)
    message = _shortened(problem.message)
    lines = [f"{where}: {problem.level}: {message}" if where else message]
    if problem.source_line:
        lines += [f"    {one}" for one in _pointed_at(problem.source_line, problem.column)]
    if problem.hint:
        lines.append(f"  hint: {_shortened(problem.hint)}")
    return "\n".join(lines)


def looked_in(problems: Iterable[DefinitionError]) -> list[str]:
    """One line with all places that were searched for missing types; no line if there are none."""
    searched = list(dict.fromkeys(each for problem in problems for each in problem.looked_in))
    return [f"  looked in: {', '.join(searched)}"] if searched else []


def _pointed_at(line: str, column: int) -> list[str]:
    """The shown part of a line, and a caret under the column if there is one."""
    start = max(0, column - _LONGEST // 2) if len(line) > _LONGEST else 0
    shown = line[start : start + _LONGEST]
    # Control characters would move the caret; a tab stays a tab to keep the caret in place.
    shown = "".join(
        one if one == "\t" or one >= " " else "\N{REPLACEMENT CHARACTER}" for one in shown
    )
    padding = "".join("\t" if one == "\t" else " " for one in shown[: column - 1 - start])
    return [shown, f"{padding}^"] if column else [shown]


def _shortened(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def _rebuild(message: str, state: dict[str, object]) -> DefinitionError:
    error = DefinitionError(message)
    error.__dict__.update(state)
    return error
