"""Messages as dicts, YAML and comma-separated values."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

from srvgen.classes.slot_types import slot_type
from taskrpc.ros.message_text import Cut, csv_of, plain, yaml_of


def message_to_ordereddict(
    msg: Any, *, truncate_length: int | None = None, no_arr: bool = False, no_str: bool = False
) -> OrderedDict[str, Any]:
    """A message as a dict of dicts, lists, numbers and strings, with its fields in order.

    Args:
        msg: any message.
        truncate_length: most characters of a string and most elements of an array; None for all.
        no_arr: show only the type and the length of arrays.
        no_str: show only the length of strings.
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
    """A message as YAML, on one line with `flow_style`; parameters as `message_to_ordereddict`."""
    return yaml_of(msg, _cut(truncate_length, no_arr, no_str), flow=flow_style)


def message_to_csv(
    msg: Any, *, truncate_length: int | None = None, no_arr: bool = False, no_str: bool = False
) -> str:
    """The values of a message, comma-separated; parameters as `message_to_ordereddict`."""
    return csv_of(msg, _cut(truncate_length, no_arr, no_str))


def get_message_slot_types(msg: Any) -> OrderedDict[str, Any]:
    """The types of a message's fields by name, as objects of `rosidl_parser.definition`."""
    nested = msg._NESTED
    types = ((name, slot_type(type_, nested.get(name))) for name, type_ in msg._FIELDS)
    return OrderedDict(types)


def _cut(length: int | None, no_arr: bool, no_str: bool) -> Cut:
    return Cut(length=length, arrays=not no_arr, texts=not no_str)


def _ordered(value: Any) -> Any:
    if isinstance(value, dict):
        return OrderedDict((name, _ordered(each)) for name, each in value.items())
    return [_ordered(each) for each in value] if isinstance(value, list) else value
