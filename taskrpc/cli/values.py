"""The request of a call, from YAML or FIELD=VALUE: read with the types of its fields at hand.

Since the types are known, a string field takes the text as it stands: `target=3,4`, `{mode: on}`
and `{id: 007}` need no quotes. What an integer cannot hold is refused, never cut off.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import yaml

from srvgen import FieldError, from_builtins
from taskrpc.cli import shells
from taskrpc.cli.command import hinted
from taskrpc.errors import InvalidRequest

_TYPE = re.compile(r"[A-Za-z]\w*/(?:\w+/)?\w+")
_TYPE_SLIP = re.compile(r"[A-Za-z]\w*(?:(?:\.|::)\w+){1,2}|[A-Z]\w*")
_ASSIGNMENT = re.compile(r"([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*)=(.*)", re.DOTALL)


def split_type(arguments: Sequence[str]) -> tuple[str, list[str]]:
    """The type that a command line names ("" where it does not), and the request after it."""
    if arguments and _TYPE.fullmatch(arguments[0]):
        return arguments[0], list(arguments[1:])
    return "", list(arguments)


def build_request(cls: Any, values: Sequence[str]) -> Any:
    """A request of this class from one YAML text or from any number of FIELD=VALUE.

    Raises InvalidRequest.
    """
    try:
        return from_builtins(cls, _read(cls, values))
    except FieldError as error:
        raise _not_populated(error) from None


def _read(cls: Any, values: Sequence[str]) -> dict[str, Any]:
    if not values:
        return {}
    if all(_ASSIGNMENT.fullmatch(value) for value in values):
        return _Assignments(cls).read(values)
    hint = shells.request_hint(values)
    stray = next(each for each in values if not _ASSIGNMENT.fullmatch(each))
    if len(values) > 1 or shells.begins_curly(stray):
        what = f"expected one YAML text, or FIELD=VALUE throughout; got {stray!r}"
        raise hinted(InvalidRequest("", what), hint)
    return _read_yaml(cls, stray, hint)


def _read_yaml(cls: Any, text: str, hint: str) -> dict[str, Any]:
    reader = _Reader(text, hint)
    node = reader.node
    if node is None:
        return {}
    if not isinstance(node, yaml.MappingNode):
        value = reader.plain(node)
        kind = type(value).__name__
        problem = f"Value '{value}' is expected to be a dictionary but is a {kind}"
        raise hinted(_not_populated(problem), hint or _shape(cls, text))
    return reader.message(node, cls)


def _shape(cls: Any, text: str) -> str:
    """How a request of this class is written."""
    if _TYPE_SLIP.fullmatch(text):
        return "a type is written as example_interfaces/srv/AddTwoInts"
    names = [name for name, _ in cls._FIELDS]
    if not names:
        return f"{cls.__name__} has no fields: leave the request out"
    return f"write the fields as {' '.join(f'{name}=…' for name in names)}"


class _Reader:
    """One YAML text and what its nodes mean for fields of known types."""

    def __init__(self, text: str, hint: str = "") -> None:
        self._text = text
        self._hint = hint
        try:
            self._loader = yaml.SafeLoader(text)
            self.node = self._loader.get_single_node()
        except yaml.YAMLError as error:
            raise self._invalid(error) from None

    def plain(self, node: yaml.Node) -> Any:
        """A node by YAML's own rules."""
        try:
            return self._loader.construct_object(node, deep=True)
        except yaml.YAMLError as error:
            raise self._invalid(error) from None

    def value(self, node: yaml.Node, type_: str, nested: Any) -> Any:
        """A node as the value of a field; `nested` is the field's message class or None."""
        element, bracket, _ = type_.partition("[")
        if bracket and isinstance(node, yaml.SequenceNode):
            return [self.value(each, element, nested) for each in node.value]
        if nested is not None and isinstance(node, yaml.MappingNode):
            return self.message(node, nested)
        if isinstance(node, yaml.ScalarNode) and not bracket:
            return self._scalar(node, element)
        return self.plain(node)

    def message(self, node: yaml.MappingNode, cls: Any) -> dict[str, Any]:
        """A mapping as the fields of a message."""
        types = dict(cls._FIELDS)
        values: dict[str, Any] = {}
        for key, value in node.value:
            name = key.value if isinstance(key, yaml.ScalarNode) else str(self.plain(key))
            if name in values:
                raise FieldError(name, "given twice")
            if name not in types:
                self._refuse_stray(name, value)
            values[name] = self.value(value, types.get(name, ""), cls._NESTED.get(name))
        return values

    def _refuse_stray(self, name: str, value: yaml.Node) -> None:
        """Say what a key without a value, which is no field either, was meant to be."""
        if isinstance(value, yaml.ScalarNode) and not value.value and value.style is None:
            problem = f"{name!r} is not a field and has no value"
            raise hinted(_not_populated(problem), shells.field_hint(name))

    def _scalar(self, node: yaml.ScalarNode, type_: str) -> Any:
        if node.style is None and shells.begins_curly(node.value):
            hint = shells.request_hint([node.value])
            problem = f"{node.value} is not quoted as YAML knows it"
            raise hinted(_not_populated(problem), hint)
        if type_.startswith(("string", "wstring")):
            return node.value
        value = self.plain(node)
        if type_.startswith("float") and isinstance(value, str) and node.style is None:
            return _float(value)
        return value

    def _invalid(self, error: yaml.YAMLError) -> InvalidRequest:
        problem = getattr(error, "problem", None) or str(error).partition("\n")[0]
        if problem.startswith("but "):
            problem = f"{getattr(error, 'context', '')}, {problem}"
        lines = [f"the request is not valid YAML: {problem}"]
        mark = getattr(error, "problem_mark", None)
        source = self._text.splitlines()
        if mark is not None and mark.line <= len(source):
            lines += [f"    {(source or [''])[min(mark.line, len(source) - 1)]}"]
            lines += ["    " + " " * mark.column + "^"]
        hint = self._hint
        if not hint and "mapping values are not allowed" in problem:
            hint = f"several fields in one line stand in braces: {shells.ONE_ARGUMENT}"
        return hinted(InvalidRequest("", "\n".join(lines)), hint)


def _not_populated(problem: object) -> InvalidRequest:
    return InvalidRequest("", f"Failed to populate field: {problem}")


def _float(text: str) -> Any:
    """`1e3` and `nan`, which YAML takes for strings, as numbers; anything else as it is."""
    try:
        return float(text)
    except ValueError:
        return text


class _Assignments:
    """FIELD=VALUE arguments, put together to the fields of one message."""

    def __init__(self, cls: Any) -> None:
        self._cls = cls
        self._values: dict[str, Any] = {}

    def read(self, values: Sequence[str]) -> dict[str, Any]:
        """What the arguments say, as one nested dict."""
        for argument in values:
            path, _, text = argument.partition("=")
            self._set(path, self._value(path, text))
        return self._values

    def _set(self, path: str, value: Any) -> None:
        *outer, name = path.split(".")
        place = self._values
        for each in outer:
            inner = place.setdefault(each, {})
            if not isinstance(inner, dict):
                raise FieldError(path, "given twice")
            place = inner
        if name in place:
            raise FieldError(path, "given twice")
        place[name] = value

    def _value(self, path: str, text: str) -> Any:
        type_, nested = self._type_of(path)
        if shells.begins_curly(text):
            hint = shells.request_hint([text])
            raise hinted(_not_populated(f"{path}: {text} is not quoted as a shell knows it"), hint)
        if type_.startswith(("string", "wstring")) and "[" not in type_:
            return text
        reader = _Reader(text)
        if reader.node is None:
            raise FieldError(path, f"expected {type_ or 'a value'}, got nothing")
        return reader.value(reader.node, type_, nested)

    def _type_of(self, path: str) -> tuple[str, Any]:
        """A field's type and message class; "" and None where there is no such field."""
        cls, type_ = self._cls, ""
        for name in path.split("."):
            if cls is None or "[" in type_:
                return "", None
            type_ = dict(cls._FIELDS).get(name, "")
            cls = cls._NESTED.get(name)
        return type_, cls
