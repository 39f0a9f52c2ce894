"""SLOT_TYPES describes the type of each field."""

from __future__ import annotations

import pytest

from srvgen.classes import slot_types
from tests.srvgen.classes.rosidl_definition import define

pytestmark = pytest.mark.usefixtures("ros_classes")


def test_slot_types_describe_each_field():
    cls = define()
    types = dict(zip(cls.get_fields_and_field_types(), cls.SLOT_TYPES, strict=True))
    basic = slot_types.BasicType
    assert types == {
        "flag": basic("boolean"),
        "raw": basic("octet"),
        "small": basic("int8"),
        "count": basic("uint16"),
        "single": basic("float"),
        "double": basic("double"),
        "text": slot_types.UnboundedString(),
        "short": slot_types.BoundedString(5),
        "inner": slot_types.NamespacedType(["rosidl_msgs", "msg"], "Inner"),
        "singles": slot_types.Array(basic("float"), 3),
        "bytes": slot_types.Array(basic("uint8"), 2),
        "flags": slot_types.Array(basic("boolean"), 2),
        "longs": slot_types.BoundedSequence(basic("int64"), 3),
        "ranges": slot_types.UnboundedSequence(basic("float")),
        "names": slot_types.UnboundedSequence(slot_types.UnboundedString()),
        "inners": slot_types.UnboundedSequence(
            slot_types.NamespacedType(["rosidl_msgs", "msg"], "Inner")
        ),
    }
    assert types["inner"].namespaced_name() == ("rosidl_msgs", "msg", "Inner")
    assert types["longs"].has_maximum_size()
    assert not types["ranges"].has_maximum_size()
    assert types["short"].has_maximum_size()
    assert not types["text"].has_maximum_size()
    assert types["double"].typename in slot_types.FLOATING_POINT_TYPES
