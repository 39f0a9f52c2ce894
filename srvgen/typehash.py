"""Type descriptions and their RIHS01 hashes, by which ROS 2 tells equal types."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from typing import Any

from .implied import implied_types, whole
from .model import Definition, Field, FieldType, MessageDef

_TYPE_IDS = {
    "int8": 2,
    "uint8": 3,
    "int16": 4,
    "uint16": 5,
    "int32": 6,
    "uint32": 7,
    "int64": 8,
    "uint64": 9,
    "float32": 10,
    "float64": 11,
    "char": 3,  # ROS 2's char is a uint8
    "bool": 15,
    "byte": 16,
    "string": 17,
    "wstring": 18,
}
_NESTED = 1
_BOUNDED_STRING = {"string": 21, "wstring": 22}
_FIXED_ARRAY, _BOUNDED_SEQUENCE, _SEQUENCE = 48, 96, 144

HIDDEN_FIELD = Field("structure_needs_at_least_one_member", FieldType("uint8"))
"""What the hash and the wire have in place of no fields at all."""

Resolve = Callable[[str], Definition]


def hash_of(definition: Definition, resolve: Resolve) -> str:
    """`RIHS01_` and 64 hex digits for a message, service, action or implied type.

    Args:
        definition: what to hash.
        resolve: gives the definition of a full name such as `std_msgs/msg/Header`.
    """
    text = json.dumps(type_description(definition, resolve), ensure_ascii=True)
    return "RIHS01_" + hashlib.sha256(text.encode()).hexdigest()


def type_description(definition: Definition, resolve: Resolve) -> dict[str, Any]:
    """The description of a type and of every type inside it, as ROS 2 hashes it."""
    own = {one.full_name: one for one in implied_types(definition)}
    found: dict[str, dict[str, Any]] = {}
    _collect(whole(definition), own, resolve, found)
    main = found.pop(definition.full_name)
    return {
        "type_description": main,
        "referenced_type_descriptions": [found[name] for name in sorted(found)],
    }


def _collect(
    message: MessageDef,
    own: dict[str, Definition],
    resolve: Resolve,
    found: dict[str, dict[str, Any]],
) -> None:
    if message.full_name in found:
        return
    fields = message.fields or (HIDDEN_FIELD,)
    found[message.full_name] = {
        "type_name": message.full_name,
        "fields": [{"name": field.name, "type": _field_type(field.type)} for field in fields],
    }
    for field in fields:
        if field.type.package:
            name = field.type.full_name
            _collect(whole(own.get(name) or resolve(name)), own, resolve, found)


def _field_type(kind: FieldType) -> dict[str, Any]:
    return {
        "type_id": _element_id(kind) + _array_offset(kind),
        "capacity": kind.array_size or 0,
        "string_capacity": kind.string_bound or 0,
        "nested_type_name": kind.full_name if kind.package else "",
    }


def _element_id(kind: FieldType) -> int:
    if kind.package:
        return _NESTED
    if kind.string_bound is not None:
        return _BOUNDED_STRING[kind.base]
    return _TYPE_IDS[kind.base]


def _array_offset(kind: FieldType) -> int:
    if not kind.is_array:
        return 0
    if kind.array_size is None:
        return _SEQUENCE
    return _BOUNDED_SEQUENCE if kind.is_upper_bound else _FIXED_ARRAY
