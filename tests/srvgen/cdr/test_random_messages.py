"""CDR of random messages of every bundled class, and of tampered bytes."""

from __future__ import annotations

import tracemalloc
from functools import partial
from random import Random
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from srvgen import CdrError, FieldError, define, from_cdr, to_cdr
from srvgen.definitions import limits
from tests.fuzz.fuzz_cdr import classes, decode_or_refuse
from tests.srvgen.cdr.reference import bundled_classes, random_message, reference_cdr

Everything = classes()[0]
of_each_fuzzed_class = pytest.mark.parametrize("cls", classes(), ids=lambda cls: cls._TYPE)


def tampered(data: bytes, at: int, new: bytes) -> bytes:
    return data[:at] + new + data[at + len(new) :]


@pytest.mark.parametrize("package", sorted({cls._TYPE.split("/")[0] for cls in bundled_classes()}))
def test_random_messages_are_encoded_by_the_rules_and_decoded_again(package):
    random = Random(package)
    for cls in (one for one in bundled_classes() if one._TYPE.startswith(f"{package}/")):
        for most in (0, 1, 3):
            message = random_message(cls, random, most)
            data = to_cdr(message)
            assert data == reference_cdr(message)
            again = from_cdr(cls, data)
            assert repr(again) == repr(message)  # by which nan equals nan
            assert to_cdr(again) == data


@given(st.integers(0), st.integers(0, 9))
@settings(max_examples=60)
def test_values_after_strings_and_sequences_are_aligned(seed, most):
    message = random_message(Everything, Random(seed), most)
    assert to_cdr(message) == reference_cdr(message)
    assert repr(from_cdr(Everything, to_cdr(message))) == repr(message)


ELEMENTS = [
    *("bool", "byte", "char", "float32", "float64", "int8", "int16", "uint32", "int64"),
    *("string", "string<=5", "wstring", "wstring<=2"),
]
ARRAYS = ["", "", "", "[]", "[1]", "[3]", "[<=2]"]


def definition_of(random: Random, fields: int, types: int, longest: int) -> str:
    """A definition with its nested ones; each may hold those that come after it."""
    names = [f"Nested{number}" for number in range(types)]
    blocks = []
    for at in range(-1, types):
        # Few fields in nested types: a message's size is the product over its levels.
        count = fields if at < 0 else random.randint(0, 3)
        inner = names[at + 1 :] if at < 0 else names[at + 1 : at + 3]
        lines = []
        for number in range(count):
            element = random.choice([random.choice(ELEMENTS), random.choice(inner or ELEMENTS)])
            name = f"f{number}" + "x" * random.randint(0, longest)
            lines.append(f"{element}{random.choice(ARRAYS)} {name}\nuint8 C{number}=1\n")
        head = "" if at < 0 else f"\n{'=' * 80}\nMSG: demo_msgs/msg/{names[at]}\n"
        blocks.append(head + "".join(lines))
    return "".join(blocks)


def assert_comes_back(cls: Any, random: Random, most: int = 2) -> None:
    message = random_message(cls, random, most)
    data = to_cdr(message)
    assert data == reference_cdr(message)
    assert repr(from_cdr(cls, data)) == repr(message)


@given(st.integers(0), st.integers(0, 140), st.integers(0, 12), st.sampled_from([0, 20, 60, 120]))
@settings(max_examples=40)
@example(seed=1, fields=129, types=12, longest=60)
def test_messages_of_every_shape_are_compiled_and_come_back(seed, fields, types, longest):
    random = Random(seed)
    text = definition_of(random, fields, types, longest)
    assert_comes_back(define("demo_msgs/msg/Shape", text), random)


@pytest.mark.parametrize("length", range(1, 121, 7))
def test_field_names_of_any_length_are_compiled(length):
    """Statements of generated code that are too long for a line are wrapped."""
    elements = [*ELEMENTS, "Nested"]
    arrays = dict.fromkeys(ARRAYS)
    lines = [
        f"{element}{array} {'x' * length}{number}_{index}"
        for number, element in enumerate(elements)
        for index, array in enumerate(arrays)
    ]
    text = "\n".join([*lines, "", "=" * 80, "MSG: demo_msgs/msg/Nested", "string text", ""])
    assert_comes_back(define("demo_msgs/msg/Long", text), Random(length))


def test_message_with_a_nested_field_for_each_of_129_alternatives_is_sent():
    """As `etsi_its_denm_ts_msgs/msg/CauseCodeChoice`, whose longest name has 61 characters."""
    types = [f"Alternative{number}" for number in range(12)]
    lines = ["uint8 choice"]
    for number in range(129):
        name = f"alternative_{number}_".ljust(61 - number % 40, "x")
        lines += [f"{types[number % 12]} {name}", f"uint8 CHOICE_{number}={number}"]
    nested = [f"\n{'=' * 80}\nMSG: demo_msgs/msg/{name}\nuint8 value\n" for name in types]
    cls = define("demo_msgs/msg/Choice", "\n".join(lines) + "\n" + "".join(nested))
    assert_comes_back(cls, Random(1))
    wrong = cls()
    field = cls.__struct_fields__[1]
    getattr(wrong, field).value = "x"
    with pytest.raises(FieldError, match=f"^{field}.value: expected uint8"):
        to_cdr(wrong)


def test_types_nested_as_deep_as_definitions_may_be_are_compiled():
    depth = limits.DEPTH - 1
    blocks = [
        f"\n{'=' * 80}\nMSG: demo_msgs/msg/Level{level}\n"
        + (f"string text\nLevel{level + 1} inner\n" if level < depth else "uint8 value\n")
        for level in range(1, depth + 1)
    ]
    cls = define("demo_msgs/msg/Level0", "string text\nLevel1 inner\n" + "".join(blocks))
    assert_comes_back(cls, Random(1))


@pytest.mark.parametrize(
    "fields", ["string[2] names", "wstring[2] names", "Inner[2] inners", "Inner inner"]
)
def test_elements_of_the_least_size_are_not_refused(fields):
    """An empty wstring has 4 bytes, and so has a string of length 0 as some vendors send it."""
    texts = {"Element": fields, "Inner": "wstring name"}
    nested = [f"\n{'=' * 80}\nMSG: demo_msgs/msg/{name}\n{texts[name]}\n" for name in texts]
    cls = define("demo_msgs/msg/Least", "Element[] elements\n" + "".join(nested))
    strings = 1 if fields == "Inner inner" else 2
    data = b"\0\1\0\0" + (3).to_bytes(4, "little") + bytes(4 * strings * 3)
    assert len(from_cdr(cls, data).elements) == 3


@pytest.mark.parametrize(
    ("fields", "least"),
    [
        ("uint8 a", 1),
        ("uint32[3] a", 12),
        ("string a", 4),
        ("string a\nstring b\nuint8 c", 9),
        ("wstring a", 4),
        ("uint8[] a\nuint8[<=9] b", 8),
        ("string[2] a", 8),
        ("wstring[2] a", 8),
        ("Inner inner", 5),
        ("Inner[2] inners", 10),
        ("Inner[] inners", 4),
    ],
)
def test_more_elements_than_the_bytes_can_hold_are_refused_before_any_is_made(fields, least):
    inner = f"\n{'=' * 80}\nMSG: demo_msgs/msg/Inner\nuint8 number\nstring name\n"
    element = f"\n{'=' * 80}\nMSG: demo_msgs/msg/Element\n{fields}\n"
    text = "Element[] elements\n" + element + (inner if "Inner" in fields else "")
    cls = define("demo_msgs/msg/Least", text)
    for size in (least * 10, least * 10 + least - 1):
        data = b"\0\1\0\0" + (11).to_bytes(4, "little") + bytes(size)
        with pytest.raises(CdrError, match=r"elements: .*11 elements"):
            from_cdr(cls, data)
    if least % 4 == 0:  # else there is padding between them
        data = b"\0\1\0\0" + (10).to_bytes(4, "little") + bytes(least * 10)
        assert len(from_cdr(cls, data).elements) == 10


@of_each_fuzzed_class
def test_truncated_message_is_refused(cls):
    data = to_cdr(random_message(cls, Random(cls._TYPE), most=2))
    for size in range(len(data)):
        with pytest.raises(CdrError):
            from_cdr(cls, data[:size])


@given(st.sampled_from(classes()), st.integers(0), st.data())
@settings(max_examples=150)
def test_tampered_bytes_are_refused_or_are_another_message(cls, seed, data):
    body = to_cdr(random_message(cls, Random(seed)))
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(4, len(body)))
        body = tampered(body, at, data.draw(st.binary(min_size=1, max_size=8)))
    decode_or_refuse(cls, body)


@pytest.mark.parametrize("length", [2**31 - 1, 2**32 - 1, 1 << 20])
@of_each_fuzzed_class
def test_memory_is_bounded_by_the_size_of_the_data(cls, length):
    data = to_cdr(random_message(cls, Random(cls._TYPE)))
    from_cdr(cls, data)  # compiles the decoder
    lies = [tampered(data, at, length.to_bytes(4, "little")) for at in range(4, len(data) - 3, 4)]

    def peak():
        tracemalloc.start()
        for lie in lies:
            decode_or_refuse(cls, lie)
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most

    # A second look where a thread of the test runner took memory meanwhile.
    assert any(peak() < 64 * len(data) + 100_000 for _ in range(2))


@pytest.mark.parametrize(
    "element",
    [
        "bool on",
        "uint16 n",
        "string s",
        "float32[] xs",
        "bool[] ons",
        "string[] names",
        "wstring w",
    ],
)
def test_memory_is_bounded_for_the_smallest_elements(element):
    text = f"Element[] elements\n{'=' * 80}\nMSG: demo_msgs/msg/Element\n{element}\n"
    cls = define("demo_msgs/msg/Demo", text.replace("\n=", "\n\n=", 1))
    smallest = to_cdr(cls._NESTED["elements"]())[4:]
    count = 20_000
    aligned = smallest if len(smallest) < 4 else smallest + bytes(-len(smallest) % 4)
    data = b"\0\1\0\0" + count.to_bytes(4, "little") + aligned * count
    tracemalloc.start()
    try:
        message = from_cdr(cls, data)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert len(message.elements) == count
    assert peak < 64 * len(data)


def test_fuzzer_finds_an_undocumented_error():
    """A check that cannot fail is a defect: a planted bug must be caught."""

    def careless(cls: Any, data: bytes) -> Any:
        return from_cdr(cls, data) if data[4] < 2 else data.decode()

    look = partial(decode_or_refuse, Everything, decode=careless)
    look(b"\0\1\0\0" + bytes(4))
    with pytest.raises(UnicodeDecodeError):
        look(b"\0\1\0\0\xff" + bytes(4))


def test_fuzzer_finds_a_message_that_encodes_to_other_bytes():
    def forgetful(cls: Any, data: bytes) -> Any:
        return from_cdr(cls, data) if len(data) < 100 else cls()

    data = to_cdr(random_message(Everything, Random(1)))
    with pytest.raises(AssertionError):
        decode_or_refuse(Everything, data, decode=forgetful)
