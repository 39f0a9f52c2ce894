"""All that a definition needs, in the order of dependency, or why it cannot be had."""

from __future__ import annotations

import keyword
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import Protocol, TypeVar

from ..definitions import limits
from ..definitions.derived import implied_types, references
from ..definitions.field_types import ROS1_TIME_TYPES
from ..definitions.lines import join_full_text
from ..definitions.model import Definition, Field, MessageDef, sections
from ..definitions.names import is_package_name
from ..errors import DefinitionError, DefinitionErrors
from .reading import read_text

T = TypeVar("T")


class Source(Protocol):
    """Where definitions come from; `Search` is the usual one."""

    def find(self, full_name: str) -> Path:
        """The file of a type."""

    def load(self, full_name: str) -> Definition:
        """The definition of a type."""

    def text(self, full_name: str) -> str:
        """The text of the file that defines a type."""


def closure(
    definition: Definition, source: Source, *, path: Path | None = None, text: str | None = None
) -> list[Definition]:
    """A definition and all that it needs; each comes after what it needs, itself last.

    Args:
        definition: where to begin.
        source: where the others are found.
        path: the file of the first, where the source does not know it.
        text: the text of the first, where it is not what the file has.

    Raises:
        DefinitionError: a type is missing, invalid, contains itself or is too large.
    """
    walk = _Walk(source)
    if path is None:
        place = _Place(source.find(definition.full_name), source.text, definition.full_name)
    elif text is None:
        place = _Place(path, read_text, path)
    else:
        place = _Place(path, str, text)
    walk.visit(definition, place)
    raise_all(walk.problems)
    return walk.ordered


def whole_error(error: DefinitionError, source: Source) -> DefinitionError:
    """The error of a text that was refused, together with what its valid lines lack."""
    walk = _Walk(source)
    walk.refuse(error)
    return one_error(walk.problems)


def full_text(definition: Definition, source: Source) -> str:
    """The text of a definition followed by those of all that it needs.

    Raises:
        DefinitionError: as `closure`.
    """
    return joined_text(closure(definition, source), source)


def joined_text(ordered: Sequence[Definition], source: Source) -> str:
    """The full text of the last of these definitions, the others being all that it needs."""
    *needed, own = (one.full_name for one in ordered)
    return join_full_text(source.text(own), {name: source.text(name) for name in needed})


def check_ros2_types(definition: Definition, path: Path) -> None:
    """Refuse ROS 1's `time` and `duration`, which the parser lets pass.

    Raises:
        DefinitionError: the definition has such a field.
    """
    raise_all(list(_ros1_types(definition, _Place(path, read_text, path))))


def raise_all(problems: list[DefinitionError]) -> None:
    """Raise what was found, if anything, as one error."""
    if problems:
        raise one_error(problems)


def one_error(problems: Sequence[DefinitionError]) -> DefinitionError:
    """The only problem, or all of them in their order."""
    if len(problems) == 1:
        return problems[0]
    return DefinitionErrors(sorted(problems, key=lambda one: (one.path, one.line, one.column)))


class _Place:
    """Where a definition stands, for errors that point into it; read only where there are any."""

    def __init__(self, path: Path, read: Callable[[T], str], what: T) -> None:
        self.path = path
        self._read = partial(read, what)

    def missing(self, field: Field, error: DefinitionError) -> DefinitionError:
        """The error of a type that cannot be had, at the field that needs it."""
        problem = self.error(field, error.message, error.hint)
        problem.looked_in = error.looked_in
        return problem

    def error(self, field: Field, message: str, hint: str = "") -> DefinitionError:
        """A problem of one field's type."""
        # A type begins its line; a field without a line belongs to an implied type.
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
    """A depth-first walk along the references from file to file."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self.ordered: list[Definition] = []
        self.problems: list[DefinitionError] = []
        self._open: list[str] = []
        self._seen: set[str] = set()
        self._missing: dict[str, DefinitionError] = {}
        self._memory: dict[str, int] = {}

    def visit(self, definition: Definition, place: _Place) -> None:
        self._seen.add(definition.full_name)
        self._open.append(definition.full_name)
        self.problems.extend(_ros1_types(definition, place))
        if keyword.iskeyword(definition.full_name.rpartition("/")[2]):
            name = definition.full_name
            problem = f"expected a type name that Python does not keep for itself, got {name!r}"
            self.problems.append(DefinitionError(problem, path=str(place.path)))
        for field in references(definition):
            if len(self.problems) >= limits.PROBLEMS:
                break  # nobody reads more, and to look for what is near costs time
            self._follow(field, place)
        self._weigh(definition, place)
        self._open.pop()
        self.ordered.append(definition)

    def refuse(self, error: DefinitionError) -> None:
        """Note what is wrong with a text, and with what its valid lines refer to."""
        self.problems.extend(problems_of(error))
        readable = error.readable
        # In a package without a valid name no type can be found.
        if isinstance(readable, Definition) and is_package_name(readable.package):
            path = Path(error.path)
            self.visit(readable, _Place(path, read_text, path))

    def _follow(self, field: Field, place: _Place) -> None:
        name = field.type.full_name
        if name in self._open:
            chain = " → ".join([*self._open[self._open.index(name) :], name])
            self.problems.append(place.error(field, f"expected a type that ends, got {chain}"))
        if name in self._missing:
            self.problems.append(place.missing(field, self._missing[name]))
        if name in self._seen:
            return
        if len(self._open) >= limits.DEPTH:
            most = f"expected at most {limits.DEPTH} types one inside the other, got more"
            self.problems.append(place.error(field, most))
            return
        try:
            needed = self.source.load(name)
        except DefinitionError as error:
            self._seen.add(name)
            if error.path:  # one inside the other file, which needs no place here
                self.refuse(error)
                return
            if field.type.package == self._open[-1].partition("/")[0]:
                error.looked_in = ()  # it is clear where a package's own types are looked for
            self._missing[name] = error
            self.problems.append(place.missing(field, error))
        else:
            self.visit(needed, _Place(self.source.find(name), self.source.text, name))

    def _weigh(self, definition: Definition, place: _Place) -> None:
        """Refuse what would fill the memory as soon as a message is made."""
        for part in (*implied_types(definition), definition):
            if isinstance(part, MessageDef):
                memory = limits.default_memory(part, self._memory)
                if memory > limits.MEMORY:
                    most = f"expected at most {limits.MEMORY:,} bytes for a message of defaults"
                    heaviest = max(part.fields, key=partial(limits.field_memory, self._memory))
                    self.problems.append(place.error(heaviest, f"{most}, got {memory:,}"))
                    memory = 0  # what holds this one is not to blame as well
                self._memory[part.full_name] = memory


def problems_of(error: DefinitionError) -> list[DefinitionError]:
    """The single problems of an error."""
    return error.problems if isinstance(error, DefinitionErrors) else [error]


def _ros1_types(definition: Definition, place: _Place) -> Iterator[DefinitionError]:
    for message in sections(definition):
        for field in message.fields:
            if field.type.package is None and field.type.base in ROS1_TIME_TYPES:
                from ..diagnostics.type_hints import ros1_hint  # only a mistake needs it

                yield place.error(
                    field,
                    f"expected a type of ROS 2, got {field.type.base!r} of ROS 1",
                    ros1_hint(field.type.base),
                )
