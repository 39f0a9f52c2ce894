"""A problem in a piece of text whose line is not known yet."""

from __future__ import annotations


class Mistake(Exception):
    """What is wrong with one word or value; the parser adds file, line and column.

    Attributes:
        message: one sentence: what was expected and what came.
        offset: where in the checked piece of text, counted from 0.
        hint: what the writer most likely meant, or "".
    """

    def __init__(self, message: str, offset: int = 0, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.offset = offset
        self.hint = hint
