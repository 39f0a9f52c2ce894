"""Type descriptions and their RIHS01 hashes, by which ROS 2 recognises equal types."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from typing import Any

from msgspec import json

from .definitions.derived import as_message, derived_types
from .definitions.model import Definition, Field, FieldType, MessageDef

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
"""The field that the hash and the encoding use for a message without fields."""

Resolve = Callable[[str], Definition]


def hash_of(definition: Definition, resolve: Resolve) -> str:
    """`RIHS01_` and 64 hex digits for a message, service, action or derived type.

    Args:
        definition: the definition to hash.
        resolve: returns the definition of a full name such as `std_msgs/msg/Header`.
    """
    return Hasher(resolve).hashes([definition])[definition.full_name]


def type_description(definition: Definition, resolve: Resolve) -> dict[str, Any]:
    """The description of a type and of every type inside it, as ROS 2 hashes it."""
    hasher = Hasher(resolve)
    hasher.know([definition])
    return {
        "type_description": hasher.description(definition.full_name),
        "referenced_type_descriptions": [
            hasher.description(name) for name in hasher.inside(definition.full_name)
        ],
    }


class Hasher:
    """Hashes several types, and describes the types that they share only once.

    Args:
        resolve: returns the definition of a full name such as `std_msgs/msg/Header`.
    """

    def __init__(self, resolve: Resolve) -> None:
        self._resolve = resolve
        self._known: dict[str, MessageDef] = {}
        self._needs: dict[str, frozenset[str]] = {}  # direct dependencies by full name
        self._texts: dict[str, bytes] = {}  # JSON descriptions by full name

    def hashes(self, definitions: Sequence[Definition]) -> dict[str, str]:
        """The hash of each definition by its full name; definitions may refer to each other."""
        self.know(definitions)
        return {one.full_name: self._hash(one.full_name) for one in definitions}

    def know(self, definitions: Sequence[Definition]) -> None:
        """Use these definitions and their derived types instead of calling `resolve`."""
        for definition in definitions:
            for one in (*derived_types(definition), definition):
                self._known.setdefault(one.full_name, as_message(one))

    def description(self, name: str) -> dict[str, Any]:
        """The description of one type without its nested types."""
        return {
            "type_name": name,
            "fields": [
                {"name": field.name, "type": _field_type(field.type)}
                for field in self._fields(name)
            ],
        }

    def inside(self, name: str) -> list[str]:
        """The full names of all nested types of a type, sorted."""
        found: set[str] = set()
        waiting = {name}
        while waiting:
            one = waiting.pop()
            waiting |= self._needed(one) - found
            found |= self._needed(one)
        return sorted(found - {name})

    def _hash(self, name: str) -> str:
        digest = hashlib.sha256(b'{"type_description": ' + self._text(name))
        digest.update(b', "referenced_type_descriptions": [')
        digest.update(b", ".join([self._text(one) for one in self.inside(name)]))
        digest.update(b"]}")
        return f"RIHS01_{digest.hexdigest()}"

    def _text(self, name: str) -> bytes:
        if name not in self._texts:
            compact = json.encode(self.description(name))
            # ROS 2 hashes the format of Python's json.dumps: one line, a space after `,` and `:`.
            self._texts[name] = json.format(compact, indent=0)
        return self._texts[name]

    def _needed(self, name: str) -> frozenset[str]:
        if name not in self._needs:
            types = (field.type for field in self._fields(name))
            self._needs[name] = frozenset(one.full_name for one in types if one.package)
        return self._needs[name]

    def _fields(self, name: str) -> tuple[Field, ...]:
        if name not in self._known:
            self._known[name] = as_message(self._resolve(name))
        return self._known[name].fields or (HIDDEN_FIELD,)


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
