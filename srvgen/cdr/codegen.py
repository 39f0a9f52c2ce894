"""Helpers that write and compile the source of encoders and decoders."""

from __future__ import annotations

from typing import Any


class Position:
    """The position of the next byte: a number while it is known, later the variable `at`.

    Additions become a statement of generated code only when the position is used.
    """

    def __init__(self, lines: list[str], *, is_known: bool) -> None:
        self._lines = lines
        self._base = "" if is_known else "at"
        self._number = 0  # bytes after the base
        self._terms: list[str] = []  # expressions of further bytes after the base

    def add(self, size: int | str) -> None:
        """Advance by a number of bytes, or by an expression."""
        if isinstance(size, int):
            self._number += size
        else:
            self._terms.append(size)

    def current(self) -> str:
        """The position as an expression: a number, or `at` after updating it."""
        if self._base == "" and not self._terms:
            return str(self._number)
        self.assign()
        return "at"

    def assign(self) -> None:
        """Write the statement that updates `at`."""
        terms = [*self._terms, *([str(self._number)] if self._number else ())]
        if self._base and terms:
            self._lines.append(f"at += {' + '.join(terms)}")
        elif not self._base:
            self._lines.append(f"at = {' + '.join(terms) or '0'}")
        self._base, self._number, self._terms = "at", 0, []

    def reset(self) -> None:
        """Use `at`, to which generated code has assigned the position itself."""
        self._base, self._number, self._terms = "at", 0, []


class Names:
    """The names by which generated code uses objects of this process."""

    def __init__(self, **known: Any) -> None:
        self.known = known

    def of(self, value: Any, letter: str) -> str:
        """A new name for an object."""
        name = f"{letter}{len(self.known)}"
        self.known[name] = value
        return name


def compiled(name: str, lines: list[str], names: Names, type_name: str) -> Any:
    """Compile the source lines and return the function of this name."""
    code = compile("\n".join(lines) + "\n", f"<srvgen CDR of {type_name}>", "exec")
    scope = dict(names.known)
    exec(code, scope)
    return scope[name]


def indented(lines: list[str]) -> list[str]:
    """The lines, indented by one more level."""
    return [f"    {line}" for line in lines]
