"""A problem in a piece of text whose line is not known yet, and the repair that it may have."""

from __future__ import annotations

from typing import NamedTuple, Self


class Repair(NamedTuple):
    """The one right text for a part of a line; offsets count from 0."""

    start: int
    end: int
    text: str


class Mistake(Exception):
    """What is wrong with one word or value; the parser adds file, line and column.

    Attributes:
        message: one sentence: what was expected and what came.
        offset: where in the checked piece of text, counted from 0.
        hint: what the writer most likely meant, or "".
        repair: what puts it right, where there is exactly one answer.
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
        """The same mistake, seen from a text in which the checked piece stands at `by`."""
        self.offset += by
        if self.repair:
            start, end, text = self.repair
            self.repair = Repair(start + by, end + by, text)
        return self
