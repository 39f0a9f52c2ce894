"""Encoding CDR: the bytes of messages."""

from __future__ import annotations

from typing import Any

import pytest

import srvgen
from srvgen import FieldError, from_cdr, load, to_cdr

AddTwoInts = load("example_interfaces/srv/AddTwoInts")
SetBool = load("example_interfaces/srv/SetBool")
Trigger = load("example_interfaces/srv/Trigger")
Path_ = load("nav_msgs/msg/Path")
PoseStamped = load("geometry_msgs/msg/PoseStamped")
String = load("std_msgs/msg/String")
WString = load("example_interfaces/msg/WString")


def define(text: str, name: str = "demo_msgs/msg/Demo") -> Any:
    return srvgen.define(name, text)


def message(text: str, **values: Any) -> Any:
    return define(text)(**values)


@pytest.mark.parametrize(
    ("sent", "expected"),
    [
        (AddTwoInts.Request(a=2, b=3), "02000000 00000000 03000000 00000000"),
        (AddTwoInts.Response(sum=5), "05000000 00000000"),
        (SetBool.Response(success=True, message="ok"), "01000000 03000000 6f6b00"),
        (Trigger.Request(), "00"),
        (String(data="Zoë"), "05000000 5a6fc3ab00"),
        (String(data="a\0b"), "04000000 61006200"),
        (WString(data="é🤖"), "03000000 e9000000 3ed80000 16dd0000"),
        (message("uint8 a\nfloat64 b\nuint8 c\nuint16 d", a=1, b=0.0, c=2, d=3),
         "01000000 00000000 00000000 00000000 02000300"),
        (message("string s\nfloat64 x\nuint8 b", s="abc", x=1.0, b=9),
         "04000000 61626300 00000000 0000f03f 09"),
        (message("float64[] xs\nuint8 b", xs=[], b=9), "00000000 09"),
        (message("float64[] xs\nuint8 b", xs=[1.0], b=9),
         "01000000 00000000 00000000 0000f03f 09"),
        (message("bool[2] on\nbyte[] raw\nchar c", on=[True, False], raw=[b"\xff"], c=7),
         "01000000 01000000 ff07"),
        (message("string[] names\nuint16 n", names=["a", "", "bcd"], n=5),
         "03000000 02000000 61000000 01000000 00000000 04000000 62636400 0500"),
        (message("uint8 a\nstring[2] names", a=1, names=["a", "b"]),
         "01000000 02000000 61000000 02000000 6200"),
        (message("wstring[] names\nuint64 n", names=["a"], n=5),
         "01000000 01000000 61000000 00000000 05000000 00000000"),
        (message("int16[3] xs\nfloat64[2] ys", xs=[1, 2, -1], ys=[1, 2]),
         "01000200 ffff0000 00000000 0000f03f 00000000 00000040"),
    ],
    ids=lambda one: type(one).__name__ if hasattr(one, "_FIELDS") else "",
)  # fmt: skip
def test_layout_rule_gives_these_bytes(sent, expected):
    data = b"\0\1\0\0" + bytes.fromhex(expected)
    assert to_cdr(sent).hex(" ", -4) == data.hex(" ", -4)
    assert from_cdr(type(sent), data) == sent


def test_message_without_fields_is_always_one_byte():
    Event = load("std_srvs/srv/Trigger").Event
    full = to_cdr(Event(request=[load("std_srvs/srv/Trigger").Request()]))
    assert len(full) - len(to_cdr(Event())) == 4  # the byte, and three before the next count
    assert len(from_cdr(Event, full).request) == 1


def test_messages_are_checked_and_converted_before_encoding():
    scan = load("sensor_msgs/msg/LaserScan")(angle_min=0.1, ranges=[1, 2.5])
    data = to_cdr(scan)
    assert scan.angle_min != 0.1  # rounded to float32, as it is sent
    assert from_cdr(type(scan), data) == scan
    far = PoseStamped()
    far.pose.position.x = "far"
    with pytest.raises(FieldError, match=r"^poses\[1\]\.pose\.position\.x: expected float64"):
        to_cdr(Path_(poses=[PoseStamped(), far]))
