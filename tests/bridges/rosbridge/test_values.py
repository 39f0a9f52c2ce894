"""Messages become JSON and back without loss, and clients' spellings are understood."""

import contextlib
import math

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import srvgen
from srvgen import FieldError
from srvgen.definitions.field_types import parse_type
from taskrpc.bridges.rosbridge.values import from_json, request_from_json, to_json
from tests.properties import examples

TYPES = [
    srvgen.load(f"test_msgs/msg/{name}")
    for name in "Arrays BasicTypes BoundedSequences MultiNested Strings WStrings".split()
] + [srvgen.load("sensor_msgs/msg/LaserScan"), srvgen.load("sensor_msgs/msg/Image")]
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=6,
)
ADD = srvgen.load("example_interfaces/srv/AddTwoInts").Request


def load(name):
    return srvgen.load(name)


def scalars(base):
    match base:
        case "bool":
            return st.booleans()
        case "float32":
            return st.floats(width=32, allow_infinity=False)
        case "float64":
            return st.floats(allow_infinity=False)
        case "byte":
            return st.binary(min_size=1, max_size=1)
    if "int" not in base and base != "char":
        return st.text(max_size=4)
    bits = 8 if base == "char" else int(base.removeprefix("u").removeprefix("int"))
    if base.startswith(("u", "c")):
        return st.integers(0, 2**bits - 1)
    return st.integers(-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)


def values_of(cls, name, text):
    type_ = parse_type(text, "test_msgs")
    nested = cls._NESTED.get(name)
    one = scalars(type_.base) if nested is None else messages(nested)
    if not type_.is_array:
        return one
    least = type_.array_size if type_.is_fixed_array else 0
    most = type_.array_size if type_.array_size is not None else 3
    return st.lists(one, min_size=least, max_size=min(most, 3) if least == 0 else most)


def messages(cls):
    fields = {
        attribute: values_of(cls, name, text)
        for (name, text), attribute in zip(cls._FIELDS, cls.__struct_fields__, strict=True)
        if not text.startswith(("string<", "wstring<"))
    }
    return st.fixed_dictionaries(fields).map(lambda values: cls(**values))


def through_json(message):
    message._check()
    return from_json(type(message), msgspec.json.decode(msgspec.json.encode(to_json(message))))


@given(st.sampled_from(TYPES).flatmap(messages))
@settings(max_examples=examples(40))
def test_message_survives_the_way_through_json(message):
    assert repr(through_json(message)) == repr(message)


@given(st.sampled_from(TYPES), JSON)
@settings(max_examples=examples(40))
def test_any_json_value_gives_a_message_or_a_field_error(cls, value):
    with contextlib.suppress(FieldError):
        from_json(cls, value, (1, 2))._check()


@given(st.data())
@settings(max_examples=examples(40))
def test_any_value_of_a_field_gives_a_message_or_a_field_error(data):
    cls = data.draw(st.sampled_from(TYPES))
    fields = data.draw(st.dictionaries(st.sampled_from([name for name, _ in cls._FIELDS]), JSON))
    with contextlib.suppress(FieldError):
        from_json(cls, fields)._check()


def test_bytes_are_base64_and_a_list_of_numbers_is_accepted():
    image = load("sensor_msgs/msg/Image")
    assert to_json(image(data=b"\x00\xff"))["data"] == "AP8="
    assert from_json(image, {"data": "AP8="}).data == [0, 255]
    assert from_json(image, {"data": [0, 255.0]}).data == [0, 255]
    with pytest.raises(FieldError, match="data: expected base64 text or a list of numbers"):
        from_json(image, {"data": "A"})


def test_numbers_that_json_does_not_have_are_null():
    scan = load("sensor_msgs/msg/LaserScan")(ranges=[1.0, math.inf, math.nan], range_max=math.nan)
    sent = msgspec.json.decode(msgspec.json.encode(to_json(scan)))
    assert (sent["ranges"], sent["range_max"]) == ([1.0, None, None], None)
    back = from_json(type(scan), {"ranges": [1, None], "range_max": None})
    assert math.isnan(back.ranges[1])
    assert math.isnan(back.range_max)


def test_both_spellings_of_a_time_are_accepted():
    time = load("builtin_interfaces/msg/Time")
    assert to_json(time(sec=1, nanosec=2)) == {"sec": 1, "nanosec": 2}
    for value in ({"sec": 1, "nanosec": 2}, {"secs": 1, "nsecs": 2}):
        assert from_json(time, value) == time(sec=1, nanosec=2)
    both = {"secs": 9, "nsecs": 9, "sec": 1, "nanosec": 2}
    assert from_json(time, both) == time(sec=1, nanosec=2)


@pytest.mark.parametrize(
    "value", [{}, {"header": {}}, {"header": {"stamp": "now"}}, {"header": {"stamp": None}}]
)
def test_published_message_without_a_stamp_gets_the_present_time(value):
    cls = load("geometry_msgs/msg/PoseStamped")
    stamp = from_json(cls, value, (5, 6)).header.stamp
    assert (stamp.sec, stamp.nanosec) == (5, 6)


def test_given_stamp_is_kept_and_the_counter_of_ros_1_is_dropped():
    value = {"header": {"seq": 7, "stamp": {"sec": 1}, "frame_id": "map"}}
    header = from_json(load("geometry_msgs/msg/PoseStamped"), value, (5, 6)).header
    assert (header.stamp.sec, header.stamp.nanosec, header.frame_id) == (1, 0, "map")


@pytest.mark.parametrize("number", [2**63 - 1, -(2**63), 5.0, "5", "-9223372036854775808"])
def test_integers_may_be_text_or_whole_floats(number):
    assert from_json(ADD, {"a": number}).a == int(number)


@pytest.mark.parametrize("wrong", [5.5, "5.0", "x", "9" * 30, [1], None])
def test_other_values_are_no_integers(wrong):
    with pytest.raises(FieldError, match=r"^a: expected int64"):
        from_json(ADD, {"a": wrong})


@pytest.mark.parametrize(
    "args", [{"a": 1, "b": 2}, [1, 2], [{"a": 1, "b": 2}]], ids=["object", "list", "object in list"]
)
def test_arguments_may_be_an_object_or_a_list(args):
    assert request_from_json(ADD, args) == ADD(a=1, b=2)


def test_no_arguments_mean_defaults():
    empty = load("std_srvs/srv/Empty").Request
    assert request_from_json(ADD, None) == request_from_json(ADD, []) == ADD()
    assert request_from_json(empty, [{}]) == empty()


def test_too_many_arguments_are_refused():
    with pytest.raises(FieldError, match=r"expected at most 2 arguments \(a, b\), got 3"):
        request_from_json(ADD, [1, 2, 3])


def test_unknown_field_is_named():
    with pytest.raises(FieldError, match="c: unknown field 'c'"):
        request_from_json(ADD, {"c": 1})
