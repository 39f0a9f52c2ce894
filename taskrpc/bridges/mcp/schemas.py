"""JSON Schemas of messages, with the comments of their definitions. Pure.

The schema of an input accepts exactly the values that `arguments.message_of` accepts, except that
it says nothing about the size of floats, or about what a base64 text contains.

ROS has constants, but no enumerations: a field may have other values too. So constants appear in
the description of their field and as examples, and exclude nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, TypeAlias

from srvgen.definitions.lines import split_full_text
from srvgen.definitions.literals import INTEGER_RANGES
from srvgen.definitions.model import (
    Constant,
    Definition,
    Field,
    FieldType,
    MessageDef,
    sections,
)
from srvgen.definitions.names import split_type_name
from srvgen.files.reading import parse_definition
from taskrpc.bridges.mcp.arguments import DRY_RUN, LONGEST_REQUEST_ID, REQUEST_ID
from taskrpc.bridges.rosbridge.values import to_json
from taskrpc.message_types import Msg

Schema: TypeAlias = dict[str, object]

_LONGEST_TEXT = 1_000
"""Most characters of a description that are passed on: definitions come from other programs."""
_HEADINGS = ("request", "response", "goal", "result", "feedback")
"""Comments that say nothing: the section is a request anyway."""
_MOST_CONSTANTS = 40
"""Most constants in the description of a field."""
_BASE64: Schema = {"type": "string", "contentEncoding": "base64"}
_OPTIONS: dict[str, Schema] = {
    REQUEST_ID: {
        "type": "string",
        "minLength": 1,
        "maxLength": LONGEST_REQUEST_ID,
        "description": "Your own id for this request, such as a new UUID. If the response of a call"
        " is lost, repeat the call with the same id and the same arguments: it runs once.",
    },
    DRY_RUN: {
        "type": "boolean",
        "default": False,
        "description": "Only check the arguments and the permission; do nothing.",
    },
}


class Definitions:
    """The definitions in a full text, such as the `_DEFINITION` of a service class."""

    def __init__(self, type_name: str, full_text: str) -> None:
        own, needed = split_full_text(full_text)
        self._type_name = type_name
        self._texts = {**needed, type_name: own}

    @property
    def sections(self) -> Sequence[MessageDef]:
        """Request and response of a service; goal, result and feedback of an action."""
        return tuple(sections(self._parsed(self._type_name)))

    def message(self, full_name: str) -> MessageDef:
        """Return the definition of a nested message."""
        found = self._parsed(full_name)
        assert isinstance(found, MessageDef), "a field has the type of a message"
        return found

    def _parsed(self, full_name: str) -> Definition:
        package, kind, name = split_type_name(full_name)
        return parse_definition(self._texts[full_name], package, kind, name, path=full_name)


def input_schema(
    cls: type[Msg], definition: MessageDef, texts: Definitions, options: Sequence[str] = ()
) -> Schema:
    """Return the schema of a request or of a goal; `options` are arguments of the tool itself."""
    schema = _whole(_Schemas(texts, is_input=True), cls, definition)
    properties = schema["properties"]
    assert isinstance(properties, dict), "made below"
    properties.update({name: _OPTIONS[name] for name in options})
    return schema


def output_schema(cls: type[Msg], definition: MessageDef, texts: Definitions) -> Schema:
    """Return the schema of a response or of a result as `to_json` writes it."""
    return _whole(_Schemas(texts, is_input=False), cls, definition)


def description(definition: MessageDef) -> str:
    """Return the comment at the start of a section, "" if there is none or only its heading."""
    text = plain_text(" ".join(definition.comment))
    return "" if text.lower() in _HEADINGS else text


def plain_text(text: str) -> str:
    """Return a text of another program on one line, without control characters, not too long."""
    text = " ".join("".join(each if each.isprintable() else " " for each in text).split())
    return text if len(text) <= _LONGEST_TEXT else f"{text[:_LONGEST_TEXT]}…"


def _whole(schemas: _Schemas, cls: Any, definition: MessageDef) -> Schema:
    schema = schemas.message(cls, definition)
    if schemas.nested:
        schema["$defs"] = schemas.nested
    return schema


class _Schemas:
    """Makes the schema of one message; `nested` has those of the messages inside, each once."""

    def __init__(self, texts: Definitions, *, is_input: bool) -> None:
        self.nested: dict[str, Schema] = {}
        self._texts = texts
        self._is_input = is_input

    def message(self, cls: Any, definition: MessageDef) -> Schema:
        defaults = to_json(cls())
        properties: dict[str, Schema] = {}
        for field in definition.fields:
            schema = self._field(field, cls._NESTED.get(field.name))
            default = defaults[field.name]
            if self._is_input and field.type.is_primitive and _is_short(default):
                schema["default"] = default
            properties[field.name] = {**schema, **_described(field, definition)}
        schema = {"type": "object", "properties": properties, "additionalProperties": False}
        if not self._is_input:
            schema["required"] = list(properties)
        if text := description(definition):
            schema["description"] = text
        return schema

    def _field(self, field: Field, nested: Any) -> Schema:
        kind = field.type
        element = self._element(kind, nested)
        if not kind.is_array:
            return element
        is_bytes = kind.base in ("uint8", "char")
        if is_bytes and not self._is_input:
            return dict(_BASE64)
        array: Schema = {"type": "array", "items": element}
        if kind.array_size is not None:
            array["maxItems"] = kind.array_size
            if kind.is_fixed_array:
                array["minItems"] = kind.array_size
        if self._is_input and (is_bytes or kind.base == "byte"):
            return {"anyOf": [array, dict(_BASE64)]}
        return array

    def _element(self, kind: FieldType, nested: Any) -> Schema:
        if nested is not None:
            return self._reference(kind.full_name, nested)
        if kind.base in INTEGER_RANGES:
            low, high = INTEGER_RANGES[kind.base]
            return {"type": "integer", "minimum": low, "maximum": high}
        if kind.base == "bool":
            return {"type": "boolean"}
        if kind.base.startswith("float"):
            return {"type": "number" if self._is_input else ["number", "null"]}
        bound = {} if kind.string_bound is None else {"maxLength": kind.string_bound}
        return {"type": "string", **bound}

    def _reference(self, full_name: str, nested: Any) -> Schema:
        key = full_name.replace("/", ".")
        if key not in self.nested:
            self.nested[key] = {}  # its place is before those of the messages inside it
            self.nested[key] = self.message(nested, self._texts.message(full_name))
        return {"$ref": f"#/$defs/{key}"}


def _is_short(default: object) -> bool:
    """Return whether a default has a place in a schema: no array of zeros, and no NaN."""
    if isinstance(default, float):
        return math.isfinite(default)
    return not isinstance(default, list)


def _described(field: Field, owner: MessageDef) -> Schema:
    texts = [" ".join(field.comment)]
    if field.unit:
        texts.append(f"[{field.unit}]")
    constants = list(_constants_of(field, owner))[:_MOST_CONSTANTS]
    if constants:
        listed = ", ".join(f"{each.name} = {each.value}" for each in constants)
        texts.append(f"Constants: {listed}")
    text = plain_text(" ".join(filter(None, texts)))
    schema: Schema = {"description": text} if text else {}
    if constants:
        schema["examples"] = [each.value for each in constants]
    return schema


def _constants_of(field: Field, owner: MessageDef) -> Iterator[Constant]:
    """Yield the constants that a field may have: those with its name, or all of its own type.

    The second rule needs a type that no other field has.
    """
    if field.type.is_array or not field.type.is_primitive:
        return
    of_type = [each for each in owner.constants if each.type == field.type.base]
    named = [each for each in of_type if each.name.startswith(f"{field.name.upper()}_")]
    is_only = sum(each.type.base == field.type.base for each in owner.fields) == 1
    for each in named or (of_type if is_only else ()):
        if not isinstance(each.value, float) or math.isfinite(each.value):
            yield each
