"""Plans: messages of every shape, size and depth are compiled."""

from __future__ import annotations

from random import Random
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from srvgen import FieldError, define, from_cdr, to_cdr
from srvgen.definitions import limits
from tests.properties import examples
from tests.srvgen.cdr.reference import random_message, reference_cdr

ELEMENTS = [
    *("bool", "byte", "char", "float32", "float64", "int8", "int16", "uint32", "int64"),
    *("string", "string<=5", "wstring", "wstring<=2"),
]


ARRAYS = ["", "", "", "[]", "[1]", "[3]", "[<=2]"]


def definition_of(random: Random, fields: int, types: int, longest: int) -> str:
    """A definition with nested ones; each may contain the ones after it."""
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
@settings(max_examples=examples(40))
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
