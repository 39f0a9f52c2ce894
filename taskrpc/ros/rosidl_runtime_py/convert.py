"""Messages as dicts, YAML and lines of values."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

from srvgen.classes.slot_types import slot_type
from taskrpc.ros.message_text import Cut, csv_of, plain, yaml_of


def message_to_ordereddict(
    msg: Any, *, truncate_length: int | None = None, no_arr: bool = False, no_str: bool = False
) -> OrderedDict[str, Any]:
    """A message as a dict of dicts, lists, numbers and texts, with its fields in order.

    Args:
        msg: any message.
        truncate_length: the most characters of a text and elements of an array.
        no_arr: of arrays only what they hold, and how many.
        no_str: of texts only their length.
    """
    return OrderedDict(_ordered(plain(msg, _cut(truncate_length, no_arr, no_str))))


def message_to_yaml(
    msg: Any,
    *,
    truncate_length: int | None = None,
    no_arr: bool = False,
    no_str: bool = False,
    flow_style: bool = False,
) -> str:
    """A message as YAML, on one line with `flow_style`; otherwise as `message_to_ordereddict`."""
    return yaml_of(msg, _cut(truncate_length, no_arr, no_str), flow=flow_style)


def message_to_csv(
    msg: Any, *, truncate_length: int | None = None, no_arr: bool = False, no_str: bool = False
) -> str:
    """All values of a message in order, between commas; otherwise as `message_to_ordereddict`."""
    return csv_of(msg, _cut(truncate_length, no_arr, no_str))


def get_message_slot_types(msg: Any) -> OrderedDict[str, Any]:
    """The type of each field of a message, by its name, as `rosidl_parser.definition` has it."""
    nested = msg._NESTED
    types = ((name, slot_type(type_, nested.get(name))) for name, type_ in msg._FIELDS)
    return OrderedDict(types)


def _cut(length: int | None, no_arr: bool, no_str: bool) -> Cut:
    return Cut(length=length, arrays=not no_arr, texts=not no_str)


def _ordered(value: Any) -> Any:
    if isinstance(value, dict):
        return OrderedDict((name, _ordered(each)) for name, each in value.items())
    return [_ordered(each) for each in value] if isinstance(value, list) else value
