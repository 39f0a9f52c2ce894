"""What ROS 2 does in silence, where it can be told from values alone: numbers and depths."""

from __future__ import annotations

import copy
import re
import sys
from typing import Any

from taskrpc.errors import InvalidRequest
from taskrpc.transport.codec import codec_of

from ...qos import HistoryPolicy
from . import explain

_NARROW = re.compile(r"(u?)int(8|16|32)\b")
_LONG = 64
"""Bits of the C integer that a Python one goes through on its way into a narrower field."""


def depth_of(qos_profile: Any) -> int:
    """How many requests a server with this profile keeps."""
    if qos_profile.history is HistoryPolicy.KEEP_ALL:
        return sys.maxsize
    return max(1, int(qos_profile.depth))


def wrapped_or_refused(message: Any, name: str, error: InvalidRequest) -> Any:
    """Like ROS, the message with its large integers cut off; else tell of it and raise the error.

    Raises the error, too, where ROS refuses the value.
    """
    wrapped = _wrapped(message)
    try:
        kind: Any = type(message)
        codec_of(kind).encode(wrapped)
    except InvalidRequest:
        raise error from None
    if not explain.like_ros():
        explain.would_wrap(name, error, wrapped)
        raise error from None
    return wrapped


def _wrapped(message: Any) -> Any:
    """A copy whose integers of up to 32 bits are cut to what fits."""
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
    """The lowest bits of a number that fits into C's long integer; any other as it is."""
    limit = 1 << (_LONG - signed)
    if not (-limit if signed else 0) <= value < limit:
        return value
    low: int = value & ((1 << bits) - 1)
    return low - (1 << bits) if signed and low >> (bits - 1) else low
