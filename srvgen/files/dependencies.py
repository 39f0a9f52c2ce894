"""Loads all dependencies of a definition in order, and reports those that are missing."""

from __future__ import annotations

import keyword
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import Protocol, TypeVar

from ..definitions import limits
from ..definitions.derived import derived_types, references
from ..definitions.field_types import ROS1_TIME_TYPES
from ..definitions.lines import join_full_text
from ..definitions.model import Definition, Field, MessageDef, sections
from ..definitions.names import is_package_name
from ..errors import DefinitionError, DefinitionErrors
from .reading import read_text

T = TypeVar("T")


class DefinitionSource(Protocol):
    """Provides definitions by name; `Search` is the usual implementation."""

    def find(self, full_name: str) -> Path:
        """The file of a type."""

    def load(self, full_name: str) -> Definition:
        """The definition of a type."""

    def text(self, full_name: str) -> str:
        """The text of the file that defines a type."""


def with_dependencies(
    definition: Definition,
    source: DefinitionSource,
    *,
    path: Path | None = None,
    text: str | None = None,
) -> list[Definition]:
    """A definition and all its dependencies; each comes after its own, the definition last.

    Args:
        definition: the definition whose dependencies are wanted.
        source: provides the dependencies.
        path: the file of the definition, if the source does not know it.
        text: the text of the definition, if it differs from the file.

    Raises:
        DefinitionError: a type is missing, invalid, contains itself or is too large.
    """
    walk = _Walk(source)
    if path is None:
        location = _Location(source.find(definition.full_name), source.text, definition.full_name)
    elif text is None:
        location = _Location(path, read_text, path)
    else:
        location = _Location(path, str, text)
    walk.visit(definition, location)
    raise_combined(walk.problems)
    return walk.ordered


def error_with_dependencies(error: DefinitionError, source: DefinitionSource) -> DefinitionError:
    """The error of an invalid text, combined with the errors of the types in its valid lines."""
    walk = _Walk(source)
    walk.add_invalid(error)
    return combined_error(walk.problems)


def full_text(definition: Definition, source: DefinitionSource) -> str:
    """The text of a definition followed by the texts of its dependencies.

    Raises:
        DefinitionError: as `with_dependencies`.
    """
    return joined_text(with_dependencies(definition, source), source)


def joined_text(ordered: Sequence[Definition], source: DefinitionSource) -> str:
    """The full text of the last definition; the others are its dependencies."""
    *needed, own = (one.full_name for one in ordered)
    return join_full_text(source.text(own), {name: source.text(name) for name in needed})


def check_ros2_types(definition: Definition, path: Path) -> None:
    """Refuse the ROS 1 types `time` and `duration`, which the parser accepts.

    Raises:
        DefinitionError: the definition has such a field.
    """
    raise_combined(list(_ros1_types(definition, _Location(path, read_text, path))))


def raise_combined(problems: list[DefinitionError]) -> None:
    """Raise the problems, if there are any, as one error."""
    if problems:
        raise combined_error(problems)


def combined_error(problems: Sequence[DefinitionError]) -> DefinitionError:
    """The only problem, or a `DefinitionErrors` with all of them in order."""
    if len(problems) == 1:
        return problems[0]
    return DefinitionErrors(sorted(problems, key=lambda one: (one.path, one.line, one.column)))


class _Location:
    """The file and text of a definition, for errors; the text is read only if there are any."""

    def __init__(self, path: Path, read: Callable[[T], str], what: T) -> None:
        self.path = path
        self._read = partial(read, what)

    def missing(self, field: Field, error: DefinitionError) -> DefinitionError:
        """The error of a missing type, at the field that needs it."""
        problem = self.error(field, error.message, error.hint)
        problem.looked_in = error.looked_in
        return problem

    def error(self, field: Field, message: str, hint: str = "") -> DefinitionError:
        """A problem of one field's type."""
        # A type begins its line; a field without a line number belongs to a derived type.
        line = self._lines[field.line - 1] if field.line else ""
        return DefinitionError(
            message,
            path=str(self.path),
            line=field.line,
            column=1 if field.line else 0,
            source_line=line,
            hint=hint,
        )

    @cached_property
    def _lines(self) -> list[str]:
        return self._read().removeprefix("\ufeff").splitlines()


class _Walk:
    """Visits a definition and its dependencies, depth first.

    Attributes:
        ordered: the definitions visited so far, dependencies first.
        problems: the errors found so far.
    """

    def __init__(self, source: DefinitionSource) -> None:
        self.source = source
        self.ordered: list[Definition] = []
        self.problems: list[DefinitionError] = []
        self._open: list[str] = []  # the types being visited, outermost first, to find cycles
        self._seen: set[str] = set()
        self._missing: dict[str, DefinitionError] = {}  # reported again at every field
        self._memory: dict[str, int] = {}  # approximate bytes of a message of each type

    def visit(self, definition: Definition, location: _Location) -> None:
        self._seen.add(definition.full_name)
        self._open.append(definition.full_name)
        self.problems.extend(_ros1_types(definition, location))
        if keyword.iskeyword(definition.full_name.rpartition("/")[2]):
            name = definition.full_name
            problem = f"expected a type name that is not a keyword of Python, got {name!r}"
            self.problems.append(DefinitionError(problem, path=str(location.path)))
        for field in references(definition):
            if len(self.problems) >= limits.PROBLEMS:
                break  # searching for similar names costs time, and so many problems are enough
            self._follow(field, location)
        self._check_memory(definition, location)
        self._open.pop()
        self.ordered.append(definition)

    def add_invalid(self, error: DefinitionError) -> None:
        """Add the problems of an invalid text, and of the types that its valid lines refer to."""
        self.problems.extend(problems_of(error))
        readable = error.readable
        # No type can be found in a package whose name is invalid.
        if isinstance(readable, Definition) and is_package_name(readable.package):
            path = Path(error.path)
            self.visit(readable, _Location(path, read_text, path))

    def _follow(self, field: Field, location: _Location) -> None:
        name = field.type.full_name
        if name in self._open:
            chain = " → ".join([*self._open[self._open.index(name) :], name])
            problem = f"expected types that do not contain themselves, got {chain}"
            self.problems.append(location.error(field, problem))
        if name in self._missing:
            self.problems.append(location.missing(field, self._missing[name]))
        if name in self._seen:
            return
        if len(self._open) >= limits.DEPTH:
            most = f"expected at most {limits.DEPTH} levels of nested types, got more"
            self.problems.append(location.error(field, most))
            return
        try:
            needed = self.source.load(name)
        except DefinitionError as error:
            self._seen.add(name)
            if error.path:  # the error is in the other file and has its own position
                self.add_invalid(error)
                return
            if field.type.package == self._open[-1].partition("/")[0]:
                error.looked_in = ()  # the package's own folder is known to the author
            self._missing[name] = error
            self.problems.append(location.missing(field, error))
        else:
            self.visit(needed, _Location(self.source.find(name), self.source.text, name))

    def _check_memory(self, definition: Definition, location: _Location) -> None:
        """Refuse a type whose new messages would use too much memory."""
        for part in (*derived_types(definition), definition):
            if isinstance(part, MessageDef):
                memory = limits.default_memory(part, self._memory)
                if memory > limits.MEMORY:
                    limit = f"{limits.MEMORY:,} bytes for a message with default values"
                    heaviest = max(part.fields, key=partial(limits.field_memory, self._memory))
                    self.problems.append(
                        location.error(heaviest, f"expected at most {limit}, got {memory:,}")
                    )
                    memory = 0  # do not report the types that contain this one
                self._memory[part.full_name] = memory


def problems_of(error: DefinitionError) -> list[DefinitionError]:
    """The problems that an error contains."""
    return error.problems if isinstance(error, DefinitionErrors) else [error]


def _ros1_types(definition: Definition, location: _Location) -> Iterator[DefinitionError]:
    for message in sections(definition):
        for field in message.fields:
            if field.type.package is None and field.type.base in ROS1_TIME_TYPES:
                from ..diagnostics.type_hints import ros1_hint  # only errors need it

                yield location.error(
                    field,
                    f"expected a type of ROS 2, got {field.type.base!r} of ROS 1",
                    ros1_hint(field.type.base),
                )
