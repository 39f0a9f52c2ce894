"""Filters by content accept the messages that Fast DDS accepts, and refuse other expressions."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

import srvgen
from taskrpc.ros.packages.rclpy._impl.content_filter import (
    MAX_PARAMETERS,
    FilterError,
    compile_filter,
)

Numbers = srvgen.load("test_msgs/msg/BasicTypes")
Texts = srvgen.load("test_msgs/msg/Strings")
Nested = srvgen.load("test_msgs/msg/Nested")

NUMBERS = [
    Numbers(int32_value=a, bool_value=b, float64_value=c, uint8_value=d)
    for a, b, c, d in [
        (-5, True, 0.5, 0),
        (0, False, 1.5, 3),
        (10, True, 2.5, 200),
        (20, False, -1.0, 7),
    ]
]
TEXTS = [Texts(string_value=text) for text in ["abc", "abd", "xyz", "", "a'b", "a%b"]]


def passing(messages, expression, *parameters):
    test = compile_filter(expression, parameters, type(messages[0]))
    return [number for number, message in enumerate(messages) if test(message)]


# The expected numbers are those of the real rclpy 9.1.2 with Fast DDS.
@pytest.mark.parametrize(
    ("expression", "parameters", "expected"),
    [
        ("int32_value > %0", ["5"], [2, 3]),
        ("int32_value > %00", ["5"], [2, 3]),
        ("int32_value<=0", [], [0, 1]),
        ("int32_value <> 10", [], [0, 1, 3]),
        ("int32_value != 10", [], [0, 1, 3]),
        ("10 < int32_value", [], [3]),
        ("int32_value > uint8_value", [], [3]),
        ("int32_value = 0x0A", [], [2]),
        ("int32_value > +5", [], [2, 3]),
        ("int32_value > 1.5", [], [2, 3]),
        ("float64_value = 5e-1", [], [0]),
        ("int32_value between %0 and %1", ["0", "10"], [1, 2]),
        ("int32_value NOT BETWEEN 0 AND 10", [], [0, 3]),
        ("int32_value BETWEEN 10 AND 0", [], []),
        ("bool_value = TRUE", [], [0, 2]),
        ("bool_value = %0", ["false"], [1, 3]),
        ("bool_value = 1", [], [0, 2]),
        ("int32_value > 5AND float64_value > 0", [], [2]),
        ("NOT int32_value > 0 AND bool_value = TRUE", [], [0]),
        ("NOT(int32_value > 0 OR bool_value = TRUE)", [], [1]),
        ("((int32_value > 0))", [], [2, 3]),
    ],
)
def test_numbers_are_compared_as_in_fast_dds(expression, parameters, expected):
    assert passing(NUMBERS, expression, *parameters) == expected


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ("int32_value < 0 AND bool_value = FALSE OR int32_value > 0", [2, 3]),
        ("int32_value > 0 OR int32_value < 0 AND bool_value = FALSE", [3]),
        ("int32_value > 0 AND NOT bool_value = TRUE OR int32_value < 0", [3]),
        ("bool_value = FALSE AND int32_value > 0 OR int32_value < 0 AND bool_value = TRUE", [0]),
    ],
)
def test_and_and_or_have_the_same_precedence(expression, expected):
    assert passing(NUMBERS, expression) == expected


@pytest.mark.parametrize(
    ("expression", "parameters", "expected"),
    [
        ("string_value = %0", ["'abc'"], [0]),
        ("string_value = `abc'", [], [0]),
        ("'abc' = string_value", [], [0]),
        ("string_value = ''", [], [3]),
        ("string_value > 'abc'", [], [1, 2]),
        ("string_value BETWEEN 'abc' AND 'abd'", [], [0, 1]),
        ("string_value like %0", ["'a%'"], [0, 1, 4, 5]),
        ("string_value LIKE 'ab*'", [], [0, 1]),
        ("string_value LIKE 'a?d'", [], [1]),
        ("string_value MATCH 'ab.'", [], [0, 1]),
        ("string_value MATCH 'b'", [], []),
    ],
)
def test_strings_are_compared_and_matched_as_in_fast_dds(expression, parameters, expected):
    assert passing(TEXTS, expression, *parameters) == expected


def test_a_field_of_a_field_is_named_with_a_dot():
    messages = [Nested(), Nested()]
    messages[1].basic_types_value.int32_value = 20
    assert passing(messages, "basic_types_value.int32_value > 10") == [1]


def test_a_pattern_in_a_field_cannot_end_the_program():
    messages = [Texts(string_value="x", bounded_string_value="("), Texts(bounded_string_value="")]
    assert passing(messages, "string_value MATCH bounded_string_value") == [1]


@pytest.mark.parametrize(
    ("kind", "expression", "parameters", "text"),
    [
        (Numbers, "int32_value == 10", [], "expected a field or a value"),
        (Numbers, "bool_value", [], "expected an operator such as ="),
        (Numbers, "nothing > 5", [], "the message has no field nothing"),
        (Numbers, "int32_value > ", [], "expected a field or a value"),
        (Numbers, "int32_value > 'a'", [], "cannot compare int32_value with 'a'"),
        (Numbers, "int32_value > %0", [], "there are 0 parameters, and none for %0"),
        (Numbers, "int32_value > %0", ["x"], "parameter %0 is 'x', expected a number"),
        (Texts, "string_value = %0", ["abc"], "or a text in single quotes"),
        (Numbers, "int32_value > 5 xor 1", [], "expected AND, OR or the end"),
        (Numbers, "5 > 3", [], "the name of a field on one side"),
        (Numbers, "int32_value LIKE 5", [], "LIKE compares strings only"),
        (Texts, "string_value MATCH '('", [], "invalid pattern"),
        (Numbers, "int32_value > 99999999999999999999", [], "expected a field or a value"),
        (Numbers, "(int32_value > 5", [], r"expected \)"),
        (Numbers, "int32_value BETWEEN uint8_value AND 5", [], "as the range of BETWEEN"),
        (Numbers, "bool_value = FaLSE", [], "no field FaLSE"),
        (Nested, "basic_types_value > 1", [], "neither a number nor a string"),
        (Numbers, "   ", [], "expected a field or a value"),
        (Numbers, "int32_value > 0", ["1"] * (MAX_PARAMETERS + 1), "at most 100"),
    ],
)
def test_an_invalid_expression_is_refused_with_its_place(kind, expression, parameters, text):
    with pytest.raises(FilterError, match=text):
        compile_filter(expression, parameters, kind)


def test_the_caret_points_to_the_problem():
    with pytest.raises(FilterError) as caught:
        compile_filter("int32_value > no", [], Numbers)
    assert (
        str(caught.value) == "the message has no field no:\n  'int32_value > no'\n" + " " * 17 + "^"
    )


_WORDS = st.sampled_from(
    "int32_value bool_value string_value AND OR NOT BETWEEN LIKE MATCH ( ) = < > <= <> %0 %1 5 'a'"
    " TRUE -1.5 ~".split()
)


@given(
    st.lists(_WORDS, max_size=9).map(" ".join) | st.text(max_size=12), st.lists(st.text(max_size=4))
)
def test_any_text_is_a_filter_or_a_filter_error(expression, parameters):
    try:
        test = compile_filter(expression, parameters, Numbers)
    except FilterError:
        return
    assert test(Numbers()) in (True, False)


@given(st.integers(-(2**31), 2**31 - 1), st.integers(-(2**31), 2**31 - 1))
def test_integers_are_compared_exactly(value, limit):
    test = compile_filter("int32_value > %0", [str(limit)], Numbers)
    assert test(Numbers(int32_value=value)) is (value > limit)
