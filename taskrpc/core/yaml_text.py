"""Reads YAML from users: every text gives a value, or a `yaml.YAMLError` with the place.

PyYAML's own SafeLoader also raises ValueError, KeyError, AttributeError and RecursionError, and
its values may be exponentially larger than the text.
"""

from __future__ import annotations

from typing import Any, NoReturn

import yaml
from yaml.constructor import ConstructorError

MAX_DEPTH = 100
"""Most levels of nested lists and mappings."""

MAX_REPEATED = 100_000
"""Most values that all aliases (`*name`) of one text may repeat together."""

MAX_INTEGER_BITS = 256
"""The size of an integer: four times that of any field, so that the field's own error is shown.

Python refuses to print an integer of some thousand digits, in an error message too.
"""

_PYTHON_ERRORS = (ArithmeticError, AttributeError, LookupError, TypeError, ValueError)


class Loader(yaml.SafeLoader):
    """Reads one YAML text: call `get_single_node`, then `construct_object` for its nodes.

    These methods, the constructor and `flatten_mapping` raise only `yaml.YAMLError`.
    """

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._depth = 0
        self._count = 0
        """Number of nodes so far, including those that aliases repeat."""
        self._repeated = 0
        self._sizes: dict[int, int] = {}
        """Number of nodes in each finished node, itself included, by its identity."""

    def fetch_more_tokens(self) -> None:
        r"""Scan the text further; called by PyYAML."""
        try:
            super().fetch_more_tokens()
        except ValueError:  # "\U99999999"
            self._fail("there is no such character", self.get_mark())

    def compose_document(self) -> Any:
        """Compose one document; called by PyYAML."""
        self._sizes.clear()  # an identity may have belonged to a node of an earlier document
        try:
            return super().compose_document()
        except RecursionError:  # the caller's own stack is deep
            self._fail("nested too deeply")

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Compose a node; called by PyYAML."""
        if self.check_event(yaml.AliasEvent):
            mark = self._next_mark()
            node: Any = super().compose_node(parent, index)
            size = self._sizes.get(id(node))
            if size is None:
                self._fail("an alias refers to an anchor that contains it", mark)
            self._count += size
            self._repeated += size
            if self._repeated > MAX_REPEATED:
                self._fail(f"aliases repeat more than {MAX_REPEATED} values", mark)
            return node
        before, self._count = self._count, self._count + 1
        self._depth += 1
        if self._depth > MAX_DEPTH:
            self._fail("nested too deeply", self._next_mark())
        node = super().compose_node(parent, index)
        self._depth -= 1
        self._sizes[id(node)] = self._count - before
        return node

    def compose_scalar_node(self, anchor: Any) -> Any:
        r"""Compose a scalar; surrogate pairs as JSON has them (`"\ud83d\ude00"`) are joined."""
        node = super().compose_scalar_node(anchor)
        if not node.value.isascii():
            try:
                node.value = node.value.encode("utf-16", "surrogatepass").decode("utf-16")
            except UnicodeDecodeError:
                self._fail("half of a surrogate pair is not a character", node.start_mark)
        return node

    def construct_object(self, node: Any, deep: bool = False) -> Any:
        """Return the value of a node, by YAML's own rules."""
        try:
            return super().construct_object(node, deep)
        except _PYTHON_ERRORS:
            kind = node.tag.rpartition(":")[2]
            shown = f"{node.value[:40]!r}" if isinstance(node.value, str) else "this"
            self._fail(f"{shown} is not a valid {kind}", node.start_mark)
        except RecursionError:
            self._fail("nested too deeply", node.start_mark)

    def construct_yaml_int(self, node: Any) -> int:
        """Return an integer; called by PyYAML."""
        number = super().construct_yaml_int(node)
        if number.bit_length() > MAX_INTEGER_BITS:
            raise ValueError
        return number

    def _next_mark(self) -> Any:
        event: Any = self.peek_event()  # type: ignore[no-untyped-call]  # the stubs lack it
        return event.start_mark

    def _fail(self, problem: str, mark: Any = None) -> NoReturn:
        raise ConstructorError(None, None, problem, mark) from None


Loader.add_constructor("tag:yaml.org,2002:int", Loader.construct_yaml_int)


def compose(text: str) -> yaml.Node | None:
    """Return the node of a YAML text, None if the text is empty. Raises yaml.YAMLError."""
    node: yaml.Node | None = Loader(text).get_single_node()
    return node


def compose_all(text: str) -> list[yaml.Node]:
    """Return the nodes of the documents of a YAML text. Raises yaml.YAMLError."""
    loader = Loader(text)
    found: list[Any] = []
    while loader.check_node():
        found.append(loader.get_node())
    return found


def load(text: str) -> Any:
    """Return the value of a YAML text, by YAML's own rules. Raises yaml.YAMLError."""
    loader = Loader(text)
    node = loader.get_single_node()
    return None if node is None else loader.construct_object(node, deep=True)


def message(error: yaml.YAMLError) -> str:
    """Return an error as one line, without its place."""
    problem: str = getattr(error, "problem", None) or str(error).partition("\n")[0]
    context = getattr(error, "context", None)
    return f"{context}, {problem}" if problem.startswith("but ") and context else problem
