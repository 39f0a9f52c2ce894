"""All that a definition needs, in the order of dependency, or why it cannot be had."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

from .errors import DefinitionError, DefinitionErrors
from .fieldtypes import ROS1_TIME_TYPES
from .files import read_text
from .implied import references
from .model import Definition, Field, sections
from .slips import ros1_hint


class Source(Protocol):
    """Where definitions come from; `Search` is the usual one."""

    def find(self, full_name: str) -> Path:
        """The file of a type."""

    def load(self, full_name: str) -> Definition:
        """The definition of a type."""


def closure(
    definition: Definition, source: Source, *, path: Path | None = None
) -> list[Definition]:
    """A definition and all that it needs; each comes after what it needs, itself last.

    Args:
        definition: where to begin.
        source: where the others are found.
        path: the file of the first, where the source does not know it.

    Raises:
        DefinitionError: a type is missing, invalid or contains itself.
    """
    walk = _Walk(source)
    walk.visit(definition, path or source.find(definition.full_name))
    raise_all(walk.problems)
    return walk.ordered


def check_ros2_types(definition: Definition, path: Path) -> None:
    """Refuse ROS 1's `time` and `duration`, which the parser lets pass.

    Raises:
        DefinitionError: the definition has such a field.
    """
    raise_all(list(_ros1_types(definition, path)))


def raise_all(problems: list[DefinitionError]) -> None:
    """Raise what was found, if anything, as one error."""
    if len(problems) > 1:
        raise DefinitionErrors(sorted(problems, key=lambda one: (one.path, one.line, one.column)))
    if problems:
        raise problems[0]


class _Walk:
    """A depth-first walk along the references from file to file."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self.ordered: list[Definition] = []
        self.problems: list[DefinitionError] = []
        self._open: list[str] = []
        self._seen: set[str] = set()

    def visit(self, definition: Definition, path: Path) -> None:
        self._seen.add(definition.full_name)
        self._open.append(definition.full_name)
        self.problems.extend(_ros1_types(definition, path))
        for field in references(definition):
            self._follow(field, path)
        self._open.pop()
        self.ordered.append(definition)

    def _follow(self, field: Field, path: Path) -> None:
        name = field.type.full_name
        if name in self._open:
            chain = " → ".join([*self._open[self._open.index(name) :], name])
            self.problems.append(_at(path, field, f"expected a type that ends, got {chain}"))
        if name in self._seen:
            return
        try:
            needed = self.source.load(name)
        except DefinitionError as error:
            self._seen.add(name)
            # An error with a place is one inside the other file and needs none here.
            self.problems.extend(
                problems_of(error) if error.path else [_at(path, field, error.message, error.hint)]
            )
        else:
            self.visit(needed, self.source.find(name))


def problems_of(error: DefinitionError) -> list[DefinitionError]:
    """The single problems of an error."""
    return error.problems if isinstance(error, DefinitionErrors) else [error]


def _ros1_types(definition: Definition, path: Path) -> Iterator[DefinitionError]:
    for message in sections(definition):
        for field in message.fields:
            if field.type.package is None and field.type.base in ROS1_TIME_TYPES:
                yield _at(
                    path,
                    field,
                    f"expected a type of ROS 2, got {field.type.base!r} of ROS 1",
                    ros1_hint(field.type.base),
                )


def _at(path: Path, field: Field, message: str, hint: str = "") -> DefinitionError:
    # A type begins its line; a field without a line belongs to an implied type.
    line = read_text(path).removeprefix("\ufeff").splitlines()[field.line - 1] if field.line else ""
    return DefinitionError(
        message,
        path=str(path),
        line=field.line,
        column=1 if field.line else 0,
        source_line=line,
        hint=hint,
    )
