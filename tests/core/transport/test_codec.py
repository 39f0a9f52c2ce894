"""A body matches its class in every field, or an InvalidRequest names the field."""

import tracemalloc
from functools import partial

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

import srvgen
import taskrpc
from taskrpc.core.transport.codec import Codec, codec_of
from tests.core.transport.helpers import Add, Text

encode = msgspec.msgpack.encode
int64 = st.integers(-(2**63), 2**63 - 1)


@given(a=int64, b=int64)
def test_encoded_messages_are_decoded(a, b):
    codec = codec_of(Add.Request)
    assert codec.decode(codec.encode(Add.Request(a=a, b=b))) == Add.Request(a=a, b=b)


@given(st.binary(max_size=40))
def test_any_bytes_are_a_message_or_an_invalid_request(body):
    for cls in (Add.Request, Text.Request, Text.Response):
        try:
            message = codec_of(cls).decode(body)
        except taskrpc.InvalidRequest:
            continue
        assert type(message) is cls
        assert codec_of(cls).decode(codec_of(cls).encode(message)) == message


@given(st.lists(st.one_of(int64, st.text(), st.none(), st.booleans(), st.floats()), max_size=4))
def test_only_the_right_fields_in_the_right_number_are_taken(values):
    is_right = len(values) == 2 and all(type(each) is int for each in values)
    try:
        codec_of(Add.Request).decode(encode(values))
        taken = True
    except taskrpc.InvalidRequest:
        taken = False
    assert taken is is_right


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (b"", "the body is not a example_interfaces/srv/AddTwoInts_Request of 2 fields"),
        (encode([1]), "the body is not a example_interfaces/srv/AddTwoInts_Request of 2 fields"),
        (encode([1, 2, 3]), "the body is not a"),
        (encode({"a": 1, "b": 2}), "the body is not a"),
        (encode([1, "x"]), "b: Expected `int`, got `str`"),
        (encode([2**63, 1]), "a: Expected `int` <= 9223372036854775807"),
        (encode([1, 2]) + b"\x00", "trailing"),
    ],
)
def test_a_wrong_body_is_named(body, said):
    with pytest.raises(taskrpc.InvalidRequest) as caught:
        codec_of(Add.Request).decode(body)
    assert said in str(caught.value)


def test_a_value_deep_inside_is_named_by_its_path():
    Plan = srvgen.load("nav_msgs/srv/GetPlan")
    codec = codec_of(Plan.Request)
    request = Plan.Request()
    request.goal.pose.position.x = "far"
    with pytest.raises(taskrpc.InvalidRequest) as caught:
        codec.encode(request)
    assert caught.value.path == "goal.pose.position.x"


@pytest.mark.parametrize(
    ("body", "path", "said"),
    [
        ([[[0, 0], "a"], [[[[0, 0], 5], []]]], "poses[0].header.frame_id", "Expected `str`"),
        ([[[0, 0], "a"], [1]], "poses[0]", "Expected `array`, got `int`"),
        ([[[0, 0], "a"], 1], "poses", "Expected `array`, got `int`"),
        ([[[0, "x"], "a"], []], "header.stamp.nanosec", "Expected `int`, got `str`"),
        ([[[0, -1], "a"], []], "header.stamp.nanosec", "Expected `int` >= 0"),
    ],
)
def test_errors_of_msgspec_contain_the_field_path(body, path, said):
    with pytest.raises(taskrpc.InvalidRequest) as caught:
        codec_of(srvgen.load("nav_msgs/msg/Path")).decode(encode(body))
    assert (caught.value.path, said in str(caught.value)) == (path, True)


EXACT = (
    "int8 int16 int32 int64 uint8 uint16 uint32 uint64 char byte bool float64 string wstring"
    " byte[] bool[] string[] wstring[]"
).split()
edges = st.sampled_from([0, 7, 8, 15, 16, 31, 32, 63]).flatmap(
    lambda bits: st.sampled_from([-(2**bits) - 1, -(2**bits), 2**bits - 1, 2**bits])
)
wire_values = st.one_of(
    edges.filter(lambda number: number >= -(2**63)),
    st.booleans(),
    st.floats(allow_nan=False),
    st.text(max_size=2),
    st.binary(max_size=2),
)


@pytest.mark.parametrize(
    "type_", [*EXACT, "float32", "string<=1", "bool[1]", "byte[<=2]", "int8[]"]
)
@given(values=st.lists(st.one_of(wire_values, st.lists(wire_values)), min_size=1, max_size=8))
def test_message_that_is_decoded_without_a_check_would_pass_it_unchanged(type_, values):
    text = f"Inner inner\nInner[] more\n{'=' * 80}\nMSG: one_msgs/msg/Inner\n{type_} value\n"
    cls = srvgen.define("one_msgs/msg/Outer", text)
    assert cls._DECODES_EXACTLY is (type_ in EXACT)
    decode = codec_of(cls).decode
    for value in values:
        try:
            message = decode(encode([[value], [[value], [value]]]))
        except taskrpc.InvalidRequest:
            continue
        before = repr(message)
        message._check()
        assert repr(message) == before


@pytest.mark.parametrize(
    ("type_", "first", "last"),
    [("int8", -128, 127), ("uint16", 0, 2**16 - 1), ("int64", -(2**63), 2**63 - 1)],
)
def test_decoding_accepts_the_range_of_an_integer_and_nothing_else(type_, first, last):
    decode = codec_of(srvgen.define("one_msgs/msg/One", f"{type_} value\n")).decode
    assert [decode(encode([value])).value for value in (first, last)] == [first, last]
    for value in (first - 1, last + 1):
        if -(2**63) <= value < 2**64:
            with pytest.raises(taskrpc.InvalidRequest, match=r"value: Expected `int` [<>]="):
                decode(encode([value]))


@pytest.mark.parametrize("count", [200, 100_000])
def test_empty_arrays_cannot_become_messages_by_the_million(count):
    """Each byte would be a message of 100,000 bytes."""
    text = "Large[] many\n" + "=" * 80 + "\nMSG: far_msgs/msg/Large\nuint8[100000] data\n"
    codec = codec_of(srvgen.define("far_msgs/msg/Many", text))
    tracemalloc.start()
    try:
        with pytest.raises(taskrpc.InvalidRequest, match="length 1") as caught:
            codec.decode(encode([[[]] * count]))
        assert tracemalloc.get_traced_memory()[1] < 2**20
    finally:
        tracemalloc.stop()
    assert caught.value.path == "many[0]"


def test_large_bodies_of_many_messages_are_taken():
    Path, PoseStamped = (
        srvgen.load("nav_msgs/msg/Path"),
        srvgen.load("geometry_msgs/msg/PoseStamped"),
    )
    codec = codec_of(Path)
    sent = Path(poses=[PoseStamped() for _ in range(2_000)])
    body = codec.encode(sent)
    assert codec.decode(body) == sent
    for cut in (body[:-1], body[:1000]):
        with pytest.raises(taskrpc.InvalidRequest, match="truncated"):
            codec.decode(cut)


def test_another_type_and_another_object_are_refused():
    codec = codec_of(Add.Request)
    for wrong in (Add.Response(), None, 42, {"a": 1}, Add.Request):
        with pytest.raises(taskrpc.InvalidRequest, match=r"expected a .*AddTwoInts_Request, got"):
            codec.encode(wrong)


def test_messages_of_many_fields_have_their_own_header():
    names = [f"f{n}" for n in range(20)]
    cls = msgspec.defstruct(
        "Wide",
        [(name, int, 0) for name in names],
        array_like=True,
        forbid_unknown_fields=True,
        namespace={
            "__annotations__": {},
            "_TYPE": "t/msg/Wide",
            "_FIELDS": tuple((name, "int64") for name in names),
            "_NESTED": {},
            "_WIDTH": 20,
            "_check": lambda self: None,
        },
    )
    codec = Codec(cls)
    assert codec.decode(codec.encode(cls(f3=7))).f3 == 7
    for count in (15, 16, 19, 21):
        with pytest.raises(taskrpc.InvalidRequest):
            codec.decode(encode([0] * count))


def test_a_codec_is_made_once():
    assert codec_of(Add.Request) is codec_of(Add.Request)


def test_long_bodies_are_decoded_with_any_field_names():
    item = "uint8[100000] filler\nint32 from\nstring[] words\nfloat32[] numbers\nbyte level\n"
    text = f"demo_msgs/Odd[] odds\n{'=' * 80}\nMSG: demo_msgs/msg/Odd\n{item}"
    cls = srvgen.define("demo_msgs/msg/Odds", text)
    odd = cls._NESTED["odds"]
    codec = Codec(cls)
    sent = cls(odds=[odd(from_=n, words=["a"], numbers=[1.5], level=b"\x07") for n in range(3)])
    body = codec.encode(sent)
    assert codec.decode(body) == sent
    assert codec._shape is not None, "the body was not looked at"


@pytest.mark.parametrize("nest", [b"\x91", b"\x81\x00"])
def test_a_body_nested_without_end_is_refused_like_any_other(nest):
    codec = Codec(srvgen.load("nav_msgs/msg/Path"))
    with pytest.raises(taskrpc.InvalidRequest):
        codec.decode(b"\x92\x92\x92\x00\x00" + nest * 200_000 + b"\x00\x90")


@pytest.fixture
def ros_class(ros_classes):
    """Makes a class as programs for ROS get it, with the environment of the test."""
    text = "float64[3] fixed\nfloat64[] free\nstring[] names\nbool[2] flags\nstring text\n"
    return partial(srvgen.define, "codec_msgs/msg/Checked", text)


def test_message_with_checked_fields_is_sent_as_its_class(ros_class):
    cls = ros_class()
    codec = Codec(cls)
    message = cls(fixed=[1.0, 2.0, 3.0], free=[4.0], names=["a"], check_fields=True)
    found = codec.decode(codec.encode(message))
    assert (type(found), found) == (cls, message)
    with pytest.raises(taskrpc.InvalidRequest, match=r"^expected a codec_msgs/msg/Checked, got "):
        codec.encode(Add.Request())


def test_messages_arrive_where_the_environment_asks_for_checked_fields(ros_class, monkeypatch):
    monkeypatch.setenv("ROS_PYTHON_CHECK_FIELDS", "1")
    cls = ros_class()
    codec = Codec(cls)
    message = cls(fixed=[1.0, 2.0, 3.0], free=[4.0], names=["a"], flags=[True, False])
    found = codec.decode(codec.encode(message))
    assert (type(found), found) == (cls, message)
    with pytest.raises(AssertionError, match="The 'text' field"):
        found.text = 5
