"""What ROS 2 does in silence with values: it wraps large integers and drops the oldest requests."""

from __future__ import annotations

import copy
import re
import sys
from typing import Any

from taskrpc.errors import InvalidRequest
from taskrpc.spi import codec_of

from ...qos import HistoryPolicy
from . import explain

_NARROW = re.compile(r"(u?)int(8|16|32)\b")
_LONG = 64
"""Bits of the C integer into which ROS converts a Python integer before it wraps it."""


def depth_of(qos_profile: Any) -> int:
    """How many requests a server with this profile keeps."""
    if qos_profile.history is HistoryPolicy.KEEP_ALL:
        return sys.maxsize
    return max(1, int(qos_profile.depth))


def wrapped_or_refused(message: Any, name: str, error: InvalidRequest) -> Any:
    """With `--like-ros`, return a copy of the message with its large integers wrapped, as in ROS.

    Otherwise report the message and raise the error. Raises it too for a value that ROS refuses.
    """
    wrapped = _wrapped(message)
    try:
        kind: Any = type(message)
        codec_of(kind).encode(wrapped)
    except InvalidRequest:
        raise error from None
    if not explain.like_ros():
        explain.number_wrapped(name, error, wrapped)
        raise error from None
    return wrapped


def _wrapped(message: Any) -> Any:
    """A copy in which integers for fields of up to 32 bits are wrapped."""
    result = copy.copy(message)
    for field, kind in message.get_fields_and_field_types().items():
        setattr(result, field, _fitting(getattr(message, field), kind))
    return result


def _fitting(value: Any, kind: str) -> Any:
    if hasattr(value, "get_fields_and_field_types"):
        return _wrapped(value)
    if isinstance(value, (list, tuple)):
        return [_fitting(each, kind) for each in value]
    narrow = _NARROW.search(kind)
    if narrow is None or not isinstance(value, int):
        return value
    return _cut(value, int(narrow[2]), signed=not narrow[1])


def _cut(value: int, bits: int, *, signed: bool) -> int:
    """The lowest bits of a number; a number beyond C's long integer stays as it is."""
    limit = 1 << (_LONG - signed)
    if not (-limit if signed else 0) <= value < limit:
        return value
    low: int = value & ((1 << bits) - 1)
    return low - (1 << bits) if signed and low >> (bits - 1) else low
