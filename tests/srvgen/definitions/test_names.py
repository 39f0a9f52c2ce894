"""Names: which ones ROS 2 accepts, and suggestions for the others."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from srvgen.definitions.names import (
    camel_case,
    did_you_mean,
    is_constant_name,
    is_field_name,
    is_message_name,
    is_one_typo,
    snake_case,
    split_type_name,
)
from srvgen.errors import DefinitionError

# The patterns of the official tools; ours say the same without backtracking.
OFFICIAL_LOWER = re.compile(r"^(?!.*__)(?!.*_$)[a-z][a-z0-9_]*\Z")
OFFICIAL_CONSTANT = re.compile(r"^[A-Z]([A-Z0-9_]?[A-Z0-9]+)*\Z")


@given(st.text(st.sampled_from("aZ0_"), max_size=10))
def test_names_are_accepted_where_the_official_patterns_accept_them(name):
    assert is_field_name(name) == bool(OFFICIAL_LOWER.match(name))
    assert is_constant_name(name) == bool(OFFICIAL_CONSTANT.match(name))


def test_a_long_bad_constant_name_is_refused_at_once():
    assert not is_constant_name("A" * 100_000 + "_")


@pytest.mark.parametrize("name", ["F", "Foo", "Sample_Foo", "Foo_Request", "Foo_Goal_Request"])
def test_messages_and_sections_may_have_these_names(name):
    assert is_message_name(name)


@pytest.mark.parametrize(
    "name", ["", "foo", "Foo_Bar", "Foo_Event", "Foo_Goal_Goal", "0Foo", "Föo"]
)
def test_messages_may_not_have_these_names(name):
    assert not is_message_name(name)


@pytest.mark.parametrize(
    ("camel", "snake"),
    [("AddTwoInts", "add_two_ints"), ("UInt8", "u_int8"), ("HTTPServer2D", "http_server2_d")],
)
def test_camel_case_becomes_snake_case_as_in_the_modules_of_ros(camel, snake):
    assert snake_case(camel) == snake


def test_a_file_name_becomes_a_type_name():
    assert camel_case("add_two-ints") == "AddTwoInts"


@pytest.mark.parametrize(
    "text", ["", "a", "a/b", "a/b/c", "a/srv/", "a/msg/B/C", "A/msg/B", "a/msg/B c"]
)
def test_invalid_full_type_name_is_refused(text):
    with pytest.raises(DefinitionError, match="expected a type name such as"):
        split_type_name(text)


def test_a_misspelt_name_is_recognised():
    assert did_you_mean("std_msg", ["std_msgs", "nav_msgs"]) == "did you mean std_msgs?"
    assert did_you_mean("addtwoints", ["AddTwoInts"]) == "did you mean AddTwoInts?"
    assert did_you_mean("quite_different", ["AddTwoInts"]) == ""


@pytest.mark.parametrize("word", ["int", "nt32", "int322", "imt32", "itn32", "nit32", "int23"])
def test_missing_extra_wrong_or_swapped_letter_is_one_typo(word):
    assert is_one_typo(word, "int32") == is_one_typo("int32", word) == (word != "int")
    assert not is_one_typo(word, word)
