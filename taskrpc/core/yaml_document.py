"""A YAML document whose values know their line and column, for error messages with a caret."""

import difflib
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NoReturn, Protocol

from taskrpc.errors import TaskRpcError

if TYPE_CHECKING:
    from yaml import Mark

_LINE_BREAK = re.compile("\r\n|[\r\n\x85\u2028\u2029]")  # as YAML counts lines


_INDENTATION = ("expected <block end>", "mapping values are not", "expected a single document")
"""The beginnings of PyYAML's messages about wrong indentation."""


class Node(Protocol):
    """The used attributes of PyYAML's nodes; its type stubs do not have all of them."""

    id: str
    tag: str
    value: Any
    style: str | None
    start_mark: "Mark"


class DocumentError(TaskRpcError, ValueError):
    """A YAML file of a user has a mistake.

    Attributes:
        problem: one sentence: what was expected and what was received.
        path: the file.
        line, column: the place, counted from 1; 0 for the whole file.
        source_line: that line of the file, or "".
    """

    def __init__(
        self, problem: str, path: str, line: int = 0, column: int = 0, source_line: str = ""
    ) -> None:
        super().__init__(problem)
        self.problem = problem
        self.path = path
        self.line = line
        self.column = column
        self.source_line = source_line

    def __str__(self) -> str:
        where = ":".join(str(part) for part in (self.path, self.line, self.column) if part)
        text = f"{where}: error: {self.problem}"
        if self.source_line:
            # Keep tabs before the caret, or it points beside the character.
            before = self.source_line[: self.column - 1]
            padding = "".join("\t" if char == "\t" else " " for char in before)
            text += f"\n    {self.source_line}\n    {padding}^"
        return text


class Document:
    """One YAML document; every method raises an `error` with the place of a wrong value.

    `what` is what messages call the whole document. Raises `error` if the document is empty or not
    valid YAML.
    """

    def __init__(
        self, text: str, path: str, *, what: str, error: type[DocumentError] = DocumentError
    ) -> None:
        self._lines = _LINE_BREAK.split(text)
        self._path = path
        self._error = error
        root = self._compose(text)
        if root is None:
            self.fail(None, f"{what} is empty")
        self.root: Node = root

    def _compose(self, text: str) -> Any:
        import yaml  # not at the top: most programs read no such file

        from taskrpc.core import yaml_text

        try:
            return yaml_text.compose(text)
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            location = (mark.line, mark.column) if mark else None
            problem = error.problem or error.context or ""
            if problem.startswith(_INDENTATION):
                problem += "; expected entries of one level to begin in the same column"
            self._fail_at(location, f"not valid YAML: {problem}")
        except yaml.reader.ReaderError as error:
            *above, before = _LINE_BREAK.split(text[: error.position])
            problem = f"not valid YAML: the character {text[error.position]!r} is not allowed"
            self._fail_at((len(above), len(before)), problem)

    def fail(self, node: Node | None, problem: str, offset: int = 0) -> NoReturn:
        """Raise an error at the place of `node`; None: for the whole file.

        `offset` is the position of the mistake in a scalar of one line.
        """
        mark = node.start_mark if node else None
        if node and offset and node.style:
            offset += 1  # the quotation mark
        self._fail_at((mark.line, mark.column + offset) if mark else None, problem)

    def _fail_at(self, location: tuple[int, int] | None, problem: str) -> NoReturn:
        if location is None:
            raise self._error(problem, self._path) from None
        line, column = location
        source_line = self._lines[line] if line < len(self._lines) else ""
        raise self._error(problem, self._path, line + 1, column + 1, source_line) from None

    def entries(self, node: Node, what: str) -> list[tuple[Node, Node]]:
        """Return the keys and values of a mapping without duplicate keys."""
        if node.id != "mapping":
            self.fail(node, f"{what}: expected entries as `name: value`, got {describe(node)}")
        seen: set[str] = set()
        for key, _ in node.value:
            if key.id != "scalar":
                self.fail(key, f"{what}: expected a name before the colon, got {describe(key)}")
            if key.value in seen:
                self.fail(key, f"{what}: {key.value!r} appears twice")
            seen.add(key.value)
        pairs: list[tuple[Node, Node]] = node.value
        return pairs

    def fields(
        self, node: Node, what: str, required: Sequence[str], optional: Sequence[str] = ()
    ) -> dict[str, Node]:
        """Return the values of a mapping; its keys must be the required and optional ones."""
        known = (*required, *optional)
        entries = self.entries(node, what)
        before = ""
        for key, value in entries:
            if key.value in known:
                before = f"; if it belongs to {key.value!r}, indent it" if _is_null(value) else ""
            else:
                near = difflib.get_close_matches(key.value, known, n=1)
                guess = f" (did you mean {near[0]!r}?)" if near else ""
                expected = f"expected {', '.join(known)}{before}"
                self.fail(key, f"{what} has no {key.value!r}{guess}: {expected}")
        fields = {key.value: value for key, value in entries}
        for name in required:
            if name not in fields:
                self.fail(None if node is self.root else node, f"{what} needs {name!r}")
        return fields

    def items(self, node: Node | None, what: str) -> list[Node]:
        """Return the values of a list; none if it is missing or empty."""
        if node is None or _is_null(node):
            return []
        if node.id != "sequence":
            self.fail(node, f"{what}: expected a list, got {describe(node)}")
        items: list[Node] = node.value
        return items


def describe(node: Node) -> str:
    """Return what an error message calls a value."""
    if node.id == "scalar":
        return "nothing" if _is_null(node) else repr(node.value)
    return f"a list of {len(node.value)}" if node.id == "sequence" else "named entries"


def _is_null(node: Node) -> bool:
    return node.tag == "tag:yaml.org,2002:null"
