"""Parses the text of a .msg, .srv or .action file into its model.

One pass reads all lines. For an invalid line the parser calls `diagnostics.line_errors`, which
finds every error and a hint; for a valid file that package is not even imported. All errors of a
file are reported in one run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

from msgspec import Struct

from .definitions import limits
from .definitions.field_types import parse_type
from .definitions.lines import SEPARATOR, leading_comments, read_comment, split_lines
from .definitions.literals import parse_default, parse_scalar
from .definitions.model import (
    PRIMITIVES,
    ActionDef,
    Constant,
    Definition,
    Field,
    Kind,
    MessageDef,
    ServiceDef,
)
from .definitions.names import (
    LOWER_RULE,
    MESSAGE_RULE,
    camel_case,
    is_constant_name,
    is_field_name,
    is_message_name,
    is_package_name,
    snake_case,
)
from .errors import DefinitionError, DefinitionErrors, InvalidText, Repair

_BOM = "\N{ZERO WIDTH NO-BREAK SPACE}"


def parse_msg(text: str, package: str, name: str, *, path: str = "") -> MessageDef:
    """Parse the text of a .msg file as the message `package/msg/name`.

    Raises:
        DefinitionError: the text is invalid; has the line and the column, and `path` as the
            name of the file. A `DefinitionErrors` if there are several problems.
    """
    parser = _Parser(text, package, path)
    parser.check_names(name, "msg")
    message = parser.section(_Span(0, len(parser.lines)), "msg", name)
    parser.raise_problems(message)
    return message


def parse_srv(text: str, package: str, name: str, *, path: str = "") -> ServiceDef:
    """Parse the text of a .srv file as the service `package/srv/name`.

    Raises:
        DefinitionError: as `parse_msg`.
    """
    parser = _Parser(text, package, path)
    parser.check_names(name, "srv", "_Request", "_Response")
    request, response = parser.split("srv", "service", ("request", "response"))
    service = ServiceDef(
        package,
        name,
        parser.section(request, "srv", f"{name}_Request"),
        parser.section(response, "srv", f"{name}_Response"),
    )
    parser.raise_problems(service)
    return service


def parse_action(text: str, package: str, name: str, *, path: str = "") -> ActionDef:
    """Parse the text of an .action file as the action `package/action/name`.

    Raises:
        DefinitionError: as `parse_msg`.
    """
    parser = _Parser(text, package, path)
    parser.check_names(name, "action", "_Goal", "_Result", "_Feedback")
    goal, result, feedback = parser.split("action", "action", ("goal", "result", "feedback"))
    action = ActionDef(
        package,
        name,
        parser.section(goal, "action", f"{name}_Goal"),
        parser.section(result, "action", f"{name}_Result"),
        parser.section(feedback, "action", f"{name}_Feedback"),
    )
    parser.raise_problems(action)
    return action


class _Span(Struct, frozen=True):
    """The lines of one section: from `start` up to, not including, `end`."""

    start: int
    end: int


class _Entry(Struct, frozen=True):
    """A field or constant; comment lines may still be added to it."""

    element: Callable[..., Field | Constant]
    arguments: tuple[Any, ...]
    comments: list[str]
    line: int
    column: int


class _Parser:
    """Parses one text and collects its problems.

    Attributes:
        lines: the lines with tabs replaced by spaces.
        left: how many more fields, constants and elements of defaults the file may have.
    """

    def __init__(self, text: str, package: str, path: str) -> None:
        self.path = path
        self.package = package
        self.problems: list[DefinitionError] = []
        self.left = limits.ENTRIES
        limits.check_text(text, path)
        self.text = text.removeprefix(_BOM)
        self.lines = split_lines(self.text)
        if text != self.text:
            self.problem(
                "expected plain UTF-8, got a byte order mark at the start of the file",
                1,
                1,
                hint='save the file as "UTF-8", not as "UTF-8 with BOM"',
            )

    def problem(
        self,
        message: str,
        line: int = 0,
        column: int = 0,
        hint: str = "",
        repair: Repair | None = None,
    ) -> None:
        """Add a problem; line and column count from 1, 0 means the whole file."""
        if len(self.problems) >= limits.PROBLEMS:
            return
        source = self._source[line - 1] if 0 < line <= len(self.lines) else ""
        problem = DefinitionError(
            message, path=self.path, line=line, column=column, source_line=source, hint=hint
        )
        problem.repair = repair
        self.problems.append(problem)

    @cached_property
    def _source(self) -> list[str]:
        return self.text.splitlines()

    def raise_problems(self, readable: Definition) -> None:
        """Raise the collected problems, if any, with the definition without its invalid lines."""
        if not self.problems:
            return
        self.problems.sort(key=lambda problem: (problem.line, problem.column))
        only = self.problems[0] if len(self.problems) == 1 else None
        error = only or DefinitionErrors(self.problems)
        error.readable = readable
        raise error

    def check_names(self, name: str, kind: Kind, *suffixes: str) -> None:
        """Check the name of the package, and of the type, which is the name of the file."""
        if not is_package_name(self.package):
            meant = snake_case(self.package)
            self.problem(
                f"expected a package name ({LOWER_RULE}), got {self.package!r}",
                hint=f"rename the package to {meant}" if is_package_name(meant) else "",
            )
        if not all(is_message_name(name + suffix) for suffix in suffixes or ("",)):
            meant = camel_case(name.removesuffix(".srv").removesuffix(".msg"))
            self.problem(
                f"expected a type name ({MESSAGE_RULE}) as the file's name, got {name!r}",
                hint=f"rename the file to {meant}.{kind}" if is_message_name(meant) else "",
            )

    def split(self, kind: Kind, noun: str, names: Sequence[str]) -> list[_Span]:
        """Find the sections of a service or action; missing ones are empty."""
        wanted = len(names) - 1
        found = [at for at, line in enumerate(self.lines) if line == SEPARATOR]
        if len(found) < wanted:
            from .diagnostics.line_hints import looks_like_separator

            lookalikes = [at for at, line in enumerate(self.lines) if looks_like_separator(line)]
            is_clear = len(lookalikes) == wanted - len(found)
            self._report_missing(
                len(found), lookalikes[: wanted - len(found)], noun, names, is_clear=is_clear
            )
            found = sorted(found + lookalikes[: wanted - len(found)])
        elif len(found) > wanted:
            hint = "a file with three sections is an action: name it .action"
            count = "one line" if wanted == 1 else "two lines"
            self.problem(
                f"expected {count} {SEPARATOR} in {_article(noun)}, "
                f"got {len(found)}; this is one too many",
                found[wanted] + 1,
                1,
                hint if kind == "srv" and len(found) == 2 else "",
            )
        starts = [0, *(at + 1 for at in found)]
        ends = [*found, len(self.lines)]
        spans = [_Span(*pair) for pair in zip(starts, ends, strict=True)]
        return (spans + [_Span(0, 0)] * wanted)[: len(names)]

    def _report_missing(
        self,
        found: int,
        lookalikes: Sequence[int],
        noun: str,
        names: Sequence[str],
        *,
        is_clear: bool,
    ) -> None:
        from .diagnostics.line_hints import separator_repair

        parts = f"{', '.join(names[:-1])} and {names[-1]}"
        count = "one line" if len(names) == 2 else "two lines"
        for at in lookalikes:
            self.problem(
                f"expected the separator {SEPARATOR} between {parts}, got {self.lines[at]!r}",
                at + 1,
                1,
                "write exactly three hyphens and nothing else on the line",
                separator_repair(self.lines[at]) if is_clear else None,
            )
        if not lookalikes:
            self.problem(
                f"expected {count} {SEPARATOR} between {parts} of {_article(noun)}, "
                f"got {found or 'none'} up to the end of the file",
                max(len(self.lines), 1),
                len(self.lines[-1].rstrip()) + 1 if self.lines else 1,
                hint=f"add a line {SEPARATOR} after the {names[found]}, even if nothing follows it",
            )

    def section(self, span: _Span, kind: Kind, name: str) -> MessageDef:
        """Parse one section and collect its problems."""
        lines = self.lines[span.start : span.end]
        leading = leading_comments(lines)
        entries = self._entries(lines[leading:], span.start + leading)
        comment = read_comment([line.lstrip("#") for line in lines[:leading]])
        built = [_build(entry) for entry in entries]
        return MessageDef(
            self.package,
            kind,
            name,
            tuple(element for element in built if isinstance(element, Field)),
            tuple(element for element in built if isinstance(element, Constant)),
            comment.lines,
            comment.unit,
        )

    def _entries(self, lines: Sequence[str], before: int) -> list[_Entry]:
        entries: list[_Entry] = []
        known: dict[str, int] = {}
        pending: list[str] = []
        for number, line in enumerate(lines, before + 1):
            if len(self.problems) >= limits.PROBLEMS:
                break  # explaining an invalid line costs far more than parsing a valid one
            code, mark, comment = line.partition("#")
            code_end = code.rstrip()
            if mark:
                if not code_end and code:
                    # An indented comment belongs to the definition above it.
                    if entries:
                        entries[-1].comments.append(comment.lstrip("#").rstrip())
                    continue
                pending.append(comment.lstrip("#").rstrip())
            if not code_end:
                continue
            entry = self._entry(code_end, number, pending)
            pending = []
            if entry and self._is_new(entry, known):
                entries.append(entry)
                self.left -= _weight(entry)
                if self.left < 0:
                    most = f"{limits.ENTRIES:,} fields, constants and elements of defaults"
                    self.problem(f"expected at most {most} in a file, got more", number, 1)
                    break
        return entries

    def _entry(self, code: str, number: int, comments: list[str]) -> _Entry | None:
        try:
            return _read(code, self.package, number, comments)
        except InvalidText:
            from .diagnostics.line_errors import errors_in_line

            for error in errors_in_line(code, self.package):
                self.problem(error.message, number, error.offset + 1, error.hint, error.repair)
            return None

    def _is_new(self, entry: _Entry, known: dict[str, int]) -> bool:
        name = str(entry.arguments[0])
        first = known.setdefault(name, entry.line)
        if first == entry.line:
            return True
        noun = "field" if entry.element is Field else "constant"
        self.problem(
            f"expected a new {noun} name, got {name!r}, which line {first} has already",
            entry.line,
            entry.column,
        )
        return False


def _read(code: str, package: str, number: int, comments: list[str]) -> _Entry:
    type_text, _, rest = code.partition(" ")
    rest = rest.lstrip()
    if not rest:
        raise InvalidText("one word only")
    column = len(code) - len(rest) + 1
    if "=" in rest:
        name, _, value = rest.partition("=")
        name = name.rstrip()
        if type_text not in PRIMITIVES or not is_constant_name(name):
            raise InvalidText("no constant")
        constant = (name, type_text, parse_scalar(value.lstrip(), type_text))
        return _Entry(Constant, constant, comments, number, column)
    name, _, default_text = rest.partition(" ")
    field_type = parse_type(type_text, package)
    if not is_field_name(name):
        raise InvalidText("no field name")
    default_text = default_text.lstrip()
    default = parse_default(default_text, field_type) if default_text else None
    return _Entry(Field, (name, field_type, default), comments, number, column)


def _weight(entry: _Entry) -> int:
    value = entry.arguments[2]
    return 1 + len(value) if isinstance(value, tuple) else 1


def _build(entry: _Entry) -> Field | Constant:
    comment = read_comment(entry.comments)
    return entry.element(*entry.arguments, comment.lines, comment.unit, entry.line, entry.column)


def _article(noun: str) -> str:
    return f"an {noun}" if noun[0] in "aeiou" else f"a {noun}"
