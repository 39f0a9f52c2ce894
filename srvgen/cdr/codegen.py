"""What the sources of compiled encoders and decoders have in common."""

from __future__ import annotations

from typing import Any


class Position:
    """Where the next byte stands: a number as long as that is known, then a variable `at`.

    What is added is written down only when the position is asked for.
    """

    def __init__(self, lines: list[str], *, is_known: bool) -> None:
        self._lines = lines
        self._base = "" if is_known else "at"
        self._number = 0
        self._terms: list[str] = []

    def add(self, size: int | str) -> None:
        """Go on by a number of bytes, or by an expression of it."""
        if isinstance(size, int):
            self._number += size
        else:
            self._terms.append(size)

    def ask(self) -> str:
        """The position: `at`, once that is brought up to date, or a number."""
        if self._base == "" and not self._terms:
            return str(self._number)
        self.assign()
        return "at"

    def assign(self) -> None:
        """Bring `at` up to date."""
        terms = [*self._terms, *([str(self._number)] if self._number else ())]
        if self._base and terms:
            self._lines.append(f"at += {' + '.join(terms)}")
        elif not self._base:
            self._lines.append(f"at = {' + '.join(terms) or '0'}")
        self._base, self._number, self._terms = "at", 0, []

    def moved(self) -> None:
        """Generated code has assigned the new position to `at` itself."""
        self._base, self._number, self._terms = "at", 0, []


class Names:
    """The names of generated code that stand for objects of ours."""

    def __init__(self, **known: Any) -> None:
        self.known = known

    def of(self, value: Any, letter: str) -> str:
        """A name for an object."""
        name = f"{letter}{len(self.known)}"
        self.known[name] = value
        return name


def compiled(name: str, lines: list[str], names: Names, type_name: str) -> Any:
    """The function of this name that the source lines define."""
    code = compile("\n".join(lines) + "\n", f"<srvgen CDR of {type_name}>", "exec")
    scope = dict(names.known)
    exec(code, scope)
    return scope[name]


def indented(lines: list[str]) -> list[str]:
    """The lines, one level deeper."""
    return [f"    {line}" for line in lines]
