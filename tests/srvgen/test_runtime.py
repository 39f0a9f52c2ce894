"""Generated classes: construct, set, check, encode, decode, compare, copy and print messages."""

from __future__ import annotations

import copy
import ctypes
import enum
import fractions
import itertools
import math
import pickle
import struct
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import srvgen
from srvgen import _runtime
from srvgen._runtime import FieldError
from srvgen.classes.loader import _Builder
from srvgen.definitions.field_types import parse_type
from srvgen.files.reading import read_definition
from srvgen.files.search import Search
from tests.properties import examples

FOLDER = Path(__file__).parents[1] / "golden" / "definitions" / "demo_interfaces"


def demo(name: str) -> Any:
    definition = read_definition(FOLDER / "msg" / f"{name}.msg")
    return getattr(_Builder(Search([FOLDER]).load, lambda _: "").build(definition), name)


Everything, Inner, Awkward = demo("Everything"), demo("Inner"), demo("Awkward")
ENCODER = msgspec.msgpack.Encoder(enc_hook=_runtime.encode_hook)


def problem_of(**values: Any) -> str:
    """The error that checking a message with these values gives."""
    message = Everything(**values)
    with pytest.raises(FieldError) as caught:
        message._check()
    return str(caught.value)


def checked(**values: Any) -> Any:
    message = Everything(**values)
    message._check()
    return message


# --- random values --------------------------------------------------------------------------------


def limits(base: str) -> tuple[int, int]:
    base = {"byte": "uint8", "char": "uint8"}.get(base, base)
    bits = int(base.removeprefix("u").removeprefix("int"))
    return (0, 2**bits - 1) if base.startswith("u") else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)


def scalars(type_: Any) -> st.SearchStrategy[Any]:
    if type_.package:
        nested = Inner if type_.base == "Inner" else Everything._NESTED["point"]
        return messages(nested)
    match type_.base:
        case "bool":
            return st.booleans()
        case "float32":
            return st.floats(width=32)
        case "float64":
            return st.floats()
        case "string" | "wstring":
            return st.text(max_size=type_.string_bound)
        case "byte":
            return st.binary(min_size=1, max_size=1)
        case base:
            return st.integers(*limits(base))


def values_of(type_: Any) -> st.SearchStrategy[Any]:
    if not type_.is_array:
        return scalars(type_)
    least = type_.array_size if type_.is_fixed_array else 0
    most = type_.array_size if type_.array_size is not None else 5
    return st.lists(scalars(type_.element), min_size=least, max_size=most)


def messages(cls: Any) -> st.SearchStrategy[Any]:
    return st.fixed_dictionaries(
        {name: values_of(parse_type(text, "demo_interfaces")) for name, text in cls._FIELDS}
    ).map(lambda values: cls(**values))


def same(one: Any, other: Any) -> bool:
    """Equality under which NaN is NaN."""
    if hasattr(one, "_FIELDS"):
        return all(same(getattr(one, name), getattr(other, name)) for name in one.__struct_fields__)
    if isinstance(one, float):
        return struct.pack("<d", one) == struct.pack("<d", other)
    if hasattr(one, "__len__") and not isinstance(one, (str, bytes)):
        return len(one) == len(other) and all(map(same, one, other))
    return type(one) is type(other) and one == other


@given(messages(Everything))
@settings(max_examples=examples(60))
def test_checked_message_survives_a_round_trip(message):
    message._check()
    arrived = msgspec.msgpack.Decoder(Everything).decode(ENCODER.encode(message))
    arrived._check()
    assert same(arrived, message)


@given(messages(Everything))
@settings(max_examples=30)
def test_a_second_check_changes_nothing(message):
    message._check()
    before = ENCODER.encode(message)
    message._check()
    assert ENCODER.encode(message) == before


INTEGERS = [
    (name, text)
    for name, text in Everything._FIELDS
    if text.split("[")[0] in ("char byte int8 uint8 int16 uint16 int32 uint32 int64 uint64".split())
]


@given(st.sampled_from(INTEGERS), st.integers(1), st.booleans())
def test_an_integer_out_of_range_is_named_with_its_path(field, by, above):
    name, text = field
    type_ = parse_type(text, "demo_interfaces")
    low, high = limits(type_.base)
    wrong = high + by if above else low - by
    size = 2 if type_.is_fixed_array else 1
    problem = problem_of(**{name: [0] * (size - 1) + [wrong] if type_.is_array else wrong})
    path = f"{name}[{size - 1}]" if type_.is_array else name
    assert problem.startswith(f"{path}: expected ")
    assert f" in {low}..{high}, got " in problem


# --- coercion -------------------------------------------------------------------------------------


class Level(enum.IntEnum):
    HIGH = 7


class Word(str):
    __slots__ = ()


@pytest.mark.parametrize(
    ("field", "given_", "held"),
    [
        ("e", True, 1),
        ("e", Level.HIGH, 7),
        ("exact", 2, 2.0),
        ("exact", fractions.Fraction(1, 2), 0.5),
        ("exact", True, 1.0),
        ("ratio", 0.1, struct.unpack("<f", struct.pack("<f", 0.1))[0]),
        ("ratio", math.inf, math.inf),
        ("flag", 0, False),
        ("raw", 255, b"\xff"),
        ("raw", bytearray(b"a"), b"a"),
        ("name", Word("Ada"), "Ada"),
        ("name", "Zoë", "Zoë"),
        ("flags", (1, 0), [True, False]),
        ("pair", [1, b"\x02"], [b"\x01", b"\x02"]),
        ("names", {"x": 1}.keys(), ["x"]),
    ],
)
def test_values_are_converted_as_in_ros(field, given_, held):
    value = getattr(checked(**{field: given_}), field)
    assert value == held
    assert type(value) is type(held)


@pytest.mark.parametrize(
    "given_",
    [[1, 2], (1, 2), range(1, 3), {1: 0, 2: 0}.keys(), bytearray(b"\1\2"), b"\1\2",
     memoryview(b"\1\2"), iter([1, 2])],
    ids=lambda one: type(one).__name__,
)  # fmt: skip
def test_every_kind_of_sequence_becomes_the_array_class(given_):
    image = checked(image=given_).image
    assert type(image) is _runtime.Uint8Array
    assert image == [1, 2]


@pytest.mark.parametrize(
    "given_",
    [[1, 2], (1, 2), range(1, 3), b"\1\2", bytearray(b"\1\2"), iter([1, 2])],
    ids=lambda one: type(one).__name__,
)
def test_numbers_become_an_array_when_they_are_set(given_):
    message = Everything()
    message.image = given_
    assert repr(message.image) == "array('B', [1, 2])"
    message.image.append(3)
    assert message.image == [1, 2, 3]
    for values in ([1, 2], b"\1\2"):
        assert repr(Everything(image=values).image) == "array('B', [1, 2])"


@pytest.mark.parametrize("cls", [Everything, Inner, Awkward], ids=lambda cls: cls.__name__)
def test_slots_are_named_as_rosidl_names_them(cls):
    message = cls()
    slots = [f"_{name}" for name in cls.get_fields_and_field_types()]
    assert message.__slots__ == [*slots, "_check_fields"]
    for slot, attribute in zip(slots, cls.__struct_fields__, strict=True):
        assert getattr(message, slot) == getattr(message, attribute)
    assert message._check_fields is False


def test_a_field_is_set_by_its_slot_too():
    message = Everything()
    message._image = [1, 2]
    assert repr(message.image) == "array('B', [1, 2])"
    assert copy.copy(message) == message


def test_invalid_array_value_is_stored_until_the_check():
    for values in ([1, "x"], [300], 5, None, "ab"):
        message = Everything(image=values)
        assert message.image is values
        message.image = values
        assert message.image is values
        with pytest.raises(FieldError, match=r"^image"):
            message._check()


def test_message_does_not_share_the_list_that_was_set():
    values = [1, 2]
    message = Everything(image=values)
    values.append(3)
    assert message.image == [1, 2]


def test_numpy_arrays_and_numbers_of_any_element_type_are_accepted():
    import numpy

    for dtype in ("int8", "int32", "int64", "uint16", ">i4", "float32", "float16", "float64"):
        assert checked(ranges=numpy.array([1, 2], dtype)).ranges == [1.0, 2.0]
    assert checked(longs=numpy.array([1, 2])[::-1]).longs == [2, 1]
    assert checked(covariance=numpy.eye(3)).covariance == [1, 0, 0, 0, 1, 0, 0, 0, 1]
    message = checked(
        e=numpy.int32(3), exact=numpy.float32(0.5), flag=numpy.bool_(False), name=numpy.str_("a")
    )
    assert (message.e, message.exact, message.flag, message.name) == (3, 0.5, False, "a")
    assert numpy.asarray(message.covariance).dtype == "float64"
    assert problem_of(longs=numpy.array([1.5])) == "longs[0]: expected int64, got 1.5 (float)"


@pytest.mark.parametrize(
    ("values", "problem"),
    [
        ({"e": 3_000_000_000}, "e: expected int32 in -2147483648..2147483647, got 3000000000"),
        ({"e": 1.0}, "e: expected int32, got 1.0 (float)"),
        ({"e": "1"}, "e: expected int32, got '1' (str)"),
        ({"e": None}, "e: expected int32, got None"),
        ({"exact": "1.5"}, "exact: expected float64, got '1.5' (str)"),
        ({"exact": 10**400}, "exact: expected float64 in -1.7976931348623157e+308.."),
        ({"exact": 10**5000}, "exact: expected float64 in -1.7976931348623157e+308.."),
        ({"width": 1e39}, "width: expected float32 in -3.4028235e+38..3.4028235e+38, got 1e+39"),
        ({"flag": 2}, "flag: expected true or false, got 2 (int)"),
        ({"flag": "true"}, "flag: expected true or false, got 'true' (str)"),
        ({"raw": b"ab"}, "raw: expected one byte, got b'ab' (bytes)"),
        ({"raw": 256}, "raw: expected uint8 in 0..255, got 256"),
        ({"name": b"x"}, "name: expected string, got b'x' (bytes)"),
        ({"name": "a\ud800"}, "name: expected text that UTF-8 can encode, got a lone surrogate"),
        ({"short": "sixsix"}, "short: expected at most 5 characters, got 6"),
        ({"codes": ["ok", "fives"]}, "codes[1]: expected at most 4 characters, got 5"),
        ({"names": "abc"}, "names: expected a list, got 'abc' (str)"),
        ({"names": ["a"] * 4}, "names: expected at most 3 elements, got 4"),
        ({"wides": ["a"]}, "wides: expected 2 elements, got 1"),
        ({"flags": [True, 3]}, "flags[1]: expected true or false, got 3 (int)"),
        ({"pair": [1, 300]}, "pair[1]: expected uint8 in 0..255, got 300"),
        ({"ranges": [0.5, 1e39]}, "ranges[1]: expected float32 in -3.4028235e+38"),
        ({"ranges": [0.5, "x"]}, "ranges[1]: expected float32, got 'x' (str)"),
        ({"ranges": b"123"}, "ranges: expected elements of 4 bytes, got 3 bytes"),
        ({"ranges": {"a": 1}}, "ranges: expected a list, got {'a': 1} (dict)"),
        ({"ranges": 5}, "ranges: expected a list, got 5 (int)"),
        ({"covariance": [1.0]}, "covariance: expected 9 elements, got 1"),
        ({"longs": [1, 2, 3, 4]}, "longs: expected at most 3 elements, got 4"),
        ({"inner": {"value": 1}}, "inner: expected demo_interfaces/msg/Inner, got {'value': 1}"),
        ({"inner": Inner(value=0.5)}, "inner.value: expected int32, got 0.5 (float)"),
        ({"two": [Inner(), Inner(value="x")]}, "two[1].value: expected int32, got 'x' (str)"),
        ({"inners": [None]}, "inners[0]: expected demo_interfaces/msg/Inner, got None"),
        ({"inners": 1}, "inners: expected a list, got 1 (int)"),
        ({"e": 10**5000}, "e: expected int32 in -2147483648..2147483647, got a far larger number"),
    ],
)  # fmt: skip
def test_error_has_path_line_column_and_message(values, problem):
    assert problem_of(**values).startswith(problem)


def test_a_hostile_repr_cannot_break_the_error():
    class Hostile:
        def __repr__(self) -> str:
            raise RuntimeError

    assert problem_of(e=Hostile()).startswith("e: expected int32, got <Hostile instance")


def test_a_field_error_has_path_and_problem_and_survives_pickling():
    error = FieldError("goal.x", "expected a number")
    again = pickle.loads(pickle.dumps(error))
    assert (again.path, again.problem, str(again)) == (
        "goal.x",
        "expected a number",
        "goal.x: expected a number",
    )


def test_class_of_another_package_with_the_same_name_is_refused():
    other = type("Inner", (), {"_TYPE": "demo_interfaces/msg/Inner"})()
    assert problem_of(inner=other).endswith("got a message of another class with that name")


def test_class_in_place_of_a_nested_message_is_refused_with_advice():
    kind = type("Inner", (), {"_TYPE": "demo_interfaces/msg/Inner"})
    assert problem_of(inner=kind).endswith("got the class Inner itself; write Inner()")


# --- the wire -------------------------------------------------------------------------------------


def test_numeric_arrays_travel_as_raw_little_endian_bytes():
    message = checked(ranges=[1.0, -2.5])
    values = msgspec.msgpack.decode(ENCODER.encode(message))
    index = [name for name, _ in Everything._FIELDS].index("ranges")
    assert values[index] == struct.pack("<2f", 1.0, -2.5)
    assert len(values) == Everything._WIDTH


def test_a_longer_message_is_refused_and_a_list_in_place_of_an_array_too():
    decoder = msgspec.msgpack.Decoder(demo("Inner"))
    with pytest.raises(msgspec.ValidationError, match="at most length 1"):
        decoder.decode(msgspec.msgpack.encode([1, 2]))
    values = msgspec.msgpack.decode(ENCODER.encode(checked()))
    index = [name for name, _ in Everything._FIELDS].index("ranges")
    values[index] = [1.0]
    with pytest.raises(msgspec.ValidationError, match="Expected `bytes`"):
        msgspec.msgpack.Decoder(Everything).decode(msgspec.msgpack.encode(values))


def test_message_with_an_invalid_value_is_not_encoded():
    with pytest.raises(NotImplementedError, match="a message cannot contain"):
        ENCODER.encode(Everything(e=object()))


# --- the array classes ----------------------------------------------------------------------------

ARRAYS = [
    getattr(_runtime, f"{name}Array")
    for name in "Int8 Uint8 Int16 Uint16 Int32 Uint32 Int64 Uint64 Float32 Float64".split()
]


@pytest.mark.parametrize("cls", ARRAYS, ids=lambda cls: cls.__name__)
def test_arrays_compare_copy_pickle_and_print(cls):
    values = cls([1, 2, 3])
    assert values == [1, 2, 3]
    assert values == (1, 2, 3)
    assert values != [1, 2]
    assert values == cls([1, 2, 3])
    assert values != "abc"
    for protocol in range(pickle.HIGHEST_PROTOCOL + 1):
        again = pickle.loads(pickle.dumps(values, protocol))
        assert (type(again), again) == (cls, values)
    for twin in (copy.copy(values), copy.deepcopy(values)):
        assert (type(twin), twin) == (cls, values)
        twin.append(4)
    assert values == [1, 2, 3]
    assert repr(values) == f"array({cls._CODE!r}, {values.tolist()})"
    assert values.itemsize * 8 == int(cls.__name__.strip("IUFointaryAl") or 0)


@pytest.mark.parametrize("cls", ARRAYS, ids=lambda cls: cls.__name__)
def test_a_slice_is_an_array_of_the_same_class(cls):
    values = cls([1, 2, 3, 4])
    for part in (slice(1, 3), slice(None, None, -1), slice(9, None), slice(-2, None)):
        assert type(values[part]) is cls
        assert values[part] == [1, 2, 3, 4][part]
    values[:2] = values[2:]
    assert values == [3, 4, 3, 4]
    assert values[-1] == 4
    assert type(values[-1]) is type(values.tolist()[-1])
    with pytest.raises(IndexError):
        values[4]


@pytest.mark.parametrize("cls", ARRAYS, ids=lambda cls: cls.__name__)
def test_numpy_views_an_array_and_writes_into_it(cls):
    import numpy

    values = cls([1, 2, 3])
    view = numpy.asarray(values)
    assert view.dtype.name == cls.__name__.removesuffix("Array").lower()
    view[1] = 9
    assert values == [1, 9, 3]


def test_bytes_are_equal_to_the_array_that_they_become():
    values = _runtime.Uint8Array(b"abc")
    assert values == b"abc"
    assert values[1:] == bytearray(b"bc")
    assert values != b"abd"
    assert bytes(values) == b"abc"
    Image = srvgen.load("sensor_msgs/msg/Image")
    sent = Image(data=b"abc")
    sent._check()
    assert [sent == Image(data=kind(b"abc")) for kind in (bytes, bytearray, memoryview, list)] == (
        [True] * 4
    )
    assert sent != Image(data=b"abd")


def test_any_buffer_is_accepted_or_refused_with_a_message():
    assert checked(ranges=(ctypes.c_float * 2)(1, 2)).ranges == [1, 2]
    assert checked(image=memoryview(b"abcd")[::2]).image == b"ac"
    assert checked(image=memoryview(b"abcdef").cast("B", (2, 3))).image == b"abcdef"
    problem = problem_of(ranges=(ctypes.c_int * 2)(1, 2))
    assert problem.startswith("ranges: expected float32 elements, got <")
    import numpy

    for scalar in (numpy.float64(3), numpy.array(3.0)):
        assert problem_of(ranges=scalar).startswith("ranges: expected a list, got ")
    pixels = numpy.arange(12, dtype="uint8").reshape(2, 2, 3)
    assert checked(image=pixels).image == list(range(12))
    assert checked(image=pixels[:, :, ::-1]).image == [2, 1, 0, 5, 4, 3, 8, 7, 6, 11, 10, 9]
    assert checked(image=numpy.zeros((0, 3), "uint8")).image == []
    assert checked(ranges=numpy.zeros(0, "float32")).ranges == []
    too_large = numpy.array([2**63], "uint64")
    assert problem_of(longs=too_large).startswith("longs[0]: expected int64 in")
    assert problem_of(ranges=numpy.array([0, 1e300])).startswith("ranges[1]: expected float32 in")


def test_array_refuses_a_number_out_of_range():
    with pytest.raises(FieldError, match=r"^\[1\]: expected int8 in -128\.\.127, got 200"):
        _runtime.Int8Array([1, 200])


# --- classes --------------------------------------------------------------------------------------


def test_setting_is_lenient_and_unknown_names_are_refused():
    message = Everything()
    message.e = "not yet checked"
    with pytest.raises(AttributeError):
        message.no_such_field = 1
    with pytest.raises(AttributeError):
        message.LEAST = 1
    with pytest.raises(TypeError, match="no_such_field"):
        Everything(no_such_field=1)
    with pytest.raises(TypeError):
        Everything(1)


@pytest.mark.parametrize("cls", [Inner, Awkward])
def test_every_class_refuses_unknown_names_with_the_same_message(cls):
    with pytest.raises(TypeError, match=r"^Extra positional arguments provided$"):
        cls(1)
    with pytest.raises(TypeError, match=r"^Unexpected keyword argument 'nope'$"):
        cls(nope=1)


def test_defaults_are_not_shared_between_messages():
    one, other = Everything(), Everything()
    one.names.append("y")
    one.letters.append(2)
    one.two[0].value = 9
    one.inner.value = 9
    assert other == Everything()
    assert other.letters == [1] == Everything.LETTERS__DEFAULT


def test_equality_is_by_value_before_and_after_a_check():
    assert Everything(ranges=[1.0], pair=(b"a", b"b")) == Everything(
        ranges=_runtime.Float32Array([1]), pair=[b"a", b"b"]
    )
    assert Everything(ranges=[1.0]) != Everything(ranges=[1.0, 2.0])
    assert Everything() != Inner()
    import numpy

    assert Everything(covariance=numpy.zeros(9)) == Everything()
    with pytest.raises(TypeError, match="unhashable"):
        hash(Everything())


def test_repr_is_that_of_rosidl():
    assert repr(Inner()) == "demo_interfaces.msg.Inner(value=3)"
    assert "ranges=[0.5], covariance=[0.0, 0.0," in repr(Everything(ranges=[0.5]))
    assert "raw=b'2'" in repr(Everything())
    assert repr(Awkward()).startswith("demo_interfaces.msg.Awkward(from=0, lambda=False, int=0")


def test_constants_and_defaults_are_class_attributes():
    assert (Everything.LEAST, Everything.MARK, Everything.YES) == (-128, b"\x07", True)
    assert Everything.RAW__DEFAULT == b"2"
    assert Everything.PAIR__DEFAULT == [b"\x01", b"\xff"]


def test_copies_are_shallow_or_deep():
    message = Everything(names=["a"], image=[1])
    message._check()
    shallow, deep = copy.copy(message), copy.deepcopy(message)
    assert shallow == deep == message
    assert shallow.names is message.names
    deep.names.append("b")
    deep.inner.value = 8
    deep.image.append(2)
    assert (message.names, message.inner.value, message.image) == (["a"], 3, [1])


@pytest.mark.parametrize("name", [name for name, _ in Awkward._FIELDS])
def test_a_field_may_have_any_name(name):
    other = {"str": "t", "in": [0.5], "class": ["c"], "list": [4], "lambda": True, "default": b"x"}
    value = True if name == "bool" else other.get(name, 5)
    message = Awkward(**{name: value})
    message._check()
    attribute = f"{name}_" if hasattr(message, f"{name}_") else name
    assert getattr(message, attribute) == value
    arrived = msgspec.msgpack.Decoder(Awkward).decode(ENCODER.encode(message))
    arrived._check()
    assert arrived == message
    assert copy.deepcopy(message) == message
    assert name in Awkward.get_fields_and_field_types()


@pytest.mark.parametrize("name", ["from", "lambda", "class", "in"])
def test_a_keyword_field_can_be_read_and_set_by_its_own_name(name):
    message = Awkward()
    value = {"from": 9, "lambda": True, "class": ["c"], "in": [0.5]}[name]
    setattr(message, name, value)
    assert getattr(message, name) == getattr(message, f"{name}_") == value
    assert message == Awkward(**{name: value}) == Awkward(**{f"{name}_": value})
    setattr(message, name, object())
    with pytest.raises(FieldError, match=rf"^{name}: "):
        message._check()


def test_no_two_numeric_classes_are_the_same():
    for one, other in itertools.combinations(ARRAYS, 2):
        assert one is not other
        assert one([1]) is not other([1])


def test_typed_service_classes_have_only_their_messages_at_run_time():
    trigger = srvgen.load("std_srvs/srv/Trigger")
    assert {name for name in dir(trigger) if name[0] != "_"} == {"Request", "Response", "Event"}
    assert trigger.__mro__[1] is _runtime.Service is _runtime.Service[int, str]
    assert not hasattr(trigger, "__orig_bases__")


def test_typed_action_classes_have_only_their_messages_at_run_time():
    fibonacci = srvgen.load("example_interfaces/action/Fibonacci")
    names = {"Goal", "Result", "Feedback", "Impl"}
    assert {name for name in dir(fibonacci) if name[0] != "_"} == names
    assert fibonacci.__mro__[1] is _runtime.Action is _runtime.Action[int, str, bytes]
    assert not hasattr(fibonacci, "__orig_bases__")
