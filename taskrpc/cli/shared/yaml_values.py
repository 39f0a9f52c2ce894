"""Reads the request of a call from YAML text, using the types of its fields."""

from __future__ import annotations

import re
from typing import Any

import yaml

from srvgen import FieldError
from taskrpc.cli.shared import quoting
from taskrpc.cli.shared.command import hinted
from taskrpc.cli.shared.quoting import NotAMapping, not_populated
from taskrpc.errors import InvalidRequest
from taskrpc.spi import yaml_text

_MERGE = "tag:yaml.org,2002:merge"
_TYPE_SLIP = re.compile(r"[A-Za-z]\w*(?:(?:\.|::)\w+){1,2}|[A-Z]\w*")


def read_mapping(cls: Any, text: str, hint: str) -> dict[str, Any]:
    """Read the fields of a request from a YAML mapping. Raises FieldError, InvalidRequest."""
    reader = Reader(text, hint)
    node = reader.node
    if node is None:
        return {}
    if not isinstance(node, yaml.MappingNode):
        value = reader.plain(node)
        kind = type(value).__name__
        problem = f"Value '{value}' is expected to be a dictionary but is a {kind}"
        error = NotAMapping("", str(not_populated(problem)))
        raise hinted(error, hint or _shape(cls, text))
    return reader.message(node, cls)


def _shape(cls: Any, text: str) -> str:
    """Return a hint: how a request of this class is written."""
    if _TYPE_SLIP.fullmatch(text):
        return "a type is written as example_interfaces/srv/AddTwoInts"
    names = [name for name, _ in cls._FIELDS]
    if not names:
        return f"{cls.__name__} has no fields: leave the request out"
    return f"write the fields as {' '.join(f'{name}=…' for name in names)}"


class Reader:
    """Reads one YAML text; `node` is its root, None for an empty text."""

    def __init__(self, text: str, hint: str = "") -> None:
        self._text = text
        self._hint = hint
        try:
            self._loader = yaml_text.Loader(text)
            self.node = self._loader.get_single_node()
        except yaml.YAMLError as error:
            raise self._invalid(error) from None

    def plain(self, node: yaml.Node) -> Any:
        """Return the value of a node by YAML's own rules."""
        try:
            return self._loader.construct_object(node, deep=True)
        except yaml.YAMLError as error:
            raise self._invalid(error) from None

    def value(self, node: yaml.Node, type_: str, nested: Any) -> Any:
        """Return a node as the value of a field; `nested` is the field's message class or None."""
        element, bracket, _ = type_.partition("[")
        if bracket and isinstance(node, yaml.SequenceNode):
            return [self.value(each, element, nested) for each in node.value]
        if nested is not None and isinstance(node, yaml.MappingNode):
            return self.message(node, nested)
        if isinstance(node, yaml.ScalarNode) and not bracket:
            return self._scalar(node, element)
        return self.plain(node)

    def message(self, node: yaml.MappingNode, cls: Any) -> dict[str, Any]:
        """Return a mapping as the fields of a message."""
        types = dict(cls._FIELDS)
        values: dict[str, Any] = {}
        merged = self._flatten(node)
        for key, value in node.value:
            name = key.value if isinstance(key, yaml.ScalarNode) else str(self.plain(key))
            if name in values and not merged:
                raise FieldError(name, "given twice")
            if name not in types:
                self._refuse_key_without_value(name, value)
            values[name] = self.value(value, types.get(name, ""), cls._NESTED.get(name))
        return values

    def _flatten(self, node: yaml.MappingNode) -> bool:
        """Merge the mappings of `<<`, which the node's own fields override; return whether any."""
        if not any(key.tag == _MERGE for key, _ in node.value):
            return False
        try:
            self._loader.flatten_mapping(node)
        except yaml.YAMLError as error:
            raise self._invalid(error) from None
        return True

    def _refuse_key_without_value(self, name: str, value: yaml.Node) -> None:
        """Raise InvalidRequest with a hint if an unknown key has no value."""
        if isinstance(value, yaml.ScalarNode) and not value.value and value.style is None:
            problem = f"{name!r} is not a field and has no value"
            raise hinted(not_populated(problem), quoting.field_hint(name))

    def _scalar(self, node: yaml.ScalarNode, type_: str) -> Any:
        if node.style is None and quoting.begins_curly(node.value):
            hint = quoting.request_hint([node.value])
            problem = f"{node.value} begins with a quotation mark that YAML does not know"
            raise hinted(not_populated(problem), hint)
        if type_.startswith(("string", "wstring")):
            return node.value
        value = self.plain(node)
        if type_.startswith("float") and isinstance(value, str) and node.style is None:
            return _float(value)
        return value

    def _invalid(self, error: yaml.YAMLError) -> InvalidRequest:
        problem = yaml_text.message(error)
        lines = [f"the request is not valid YAML: {problem}"]
        mark = getattr(error, "problem_mark", None)
        source = self._text.splitlines()
        if mark is not None and mark.line <= len(source):
            lines += [f"    {(source or [''])[min(mark.line, len(source) - 1)]}"]
            lines += ["    " + " " * mark.column + "^"]
        hint = self._hint
        if not hint and "mapping values are not allowed" in problem:
            hint = f"put several fields on one line in braces: {quoting.ONE_ARGUMENT}"
        return hinted(InvalidRequest("", "\n".join(lines)), hint)


def _float(text: str) -> Any:
    """Return `1e3` and `nan`, which YAML reads as strings, as numbers; any other text unchanged."""
    try:
        return float(text)
    except ValueError:
        return text
