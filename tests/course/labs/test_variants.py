"""The choices of a variant."""

from hypothesis import given
from hypothesis import strategies as st

from taskrpc.course.labs.variants import Variant


def test_without_an_id_each_choice_is_the_first():
    variant = Variant()
    assert variant.choose("name", ["a", "b", "c"]) == "a"
    assert variant.number("count", 3, 9) == 3
    assert variant.order("order", [3, 1, 2]) == [3, 1, 2]


@given(st.text(), st.integers(1, 20))
def test_the_same_id_gives_the_same_choices(id, count):
    options = list(range(count))
    one, other = Variant(id), Variant(id)
    assert one.choose("name", options) == other.choose("name", options)
    assert one.order("order", options) == other.order("order", options)
    assert sorted(one.order("order", options)) == options
    assert 5 <= one.number("number", 5, 5 + count) <= 5 + count


def test_students_have_different_choices():
    names = {Variant(f"student{number}").choose("name", "abcde") for number in range(100)}
    assert names == set("abcde")


def test_choices_are_the_same_on_every_machine_and_in_every_version():
    assert Variant("ada").number("number", 0, 999_999) == 797_086
