"""Tampered messages: what the CDR decoder promises about any bytes."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from srvgen import CdrError, define, from_cdr, load, to_cdr

EVERYTHING = f"""bool flag
byte raw
char letter
float32 ratio
float64 exact
int16 c
uint64 h
string name
string<=5 short
wstring wide
wstring<=3 narrow
Inner inner
Empty nothing
bool[] flags
bool[3] three
byte[2] pair
byte[] bytes
string[<=3] names
string<=4[2] codes
wstring[] wides
float32[] ranges
float64[3] covariance
uint8[] image
int64[<=3] longs
float64[] exacts
Inner[] inners
Inner[2] two
Empty[] nothings

{"=" * 80}
MSG: demo_msgs/msg/Inner
uint8 a
float64 b
string c
int16[] d

{"=" * 80}
MSG: demo_msgs/msg/Empty
"""
"""A definition with a field of every kind, in an order that needs every kind of padding."""

TYPES = (
    "nav_msgs/msg/Path",
    "sensor_msgs/msg/LaserScan",
    "diagnostic_msgs/msg/DiagnosticArray",
    "rcl_interfaces/msg/ParameterEvent",
    "example_interfaces/msg/WString",
)


def decode_or_refuse(cls: Any, data: bytes, decode: Callable[[Any, bytes], Any] = from_cdr) -> None:
    """Decode, and check the decoder's promises.

    Raises:
        AssertionError: the message does not pass its own check, or is not what the data said.
        Exception: the decoder raised an undocumented exception.
    """
    try:
        message = decode(cls, data)
    except CdrError:
        return
    before = repr(message)
    again = to_cdr(message)
    assert repr(message) == before
    assert repr(from_cdr(cls, again)) == before
    # Nothing was passed over but padding at the end; strings without NUL only get longer.
    assert len(data) - 3 <= len(again)


@cache
def tampered_classes() -> tuple[Any, ...]:
    """The classes of the messages that are tampered with."""
    return (define("demo_msgs/msg/Everything", EVERYTHING), *map(load, TYPES))
