"""Rendered checks: they convert valid values and name invalid ones."""

from __future__ import annotations

import pytest

import srvgen
from srvgen.classes.render import render
from srvgen.definitions.lines import join_full_text
from srvgen.files.search import BUNDLED, Search
from srvgen.parser import parse_msg
from srvgen.typehash import Hasher


def test_a_type_named_like_an_exception_does_not_hide_it():
    texts = {"demo_msgs/msg/ValueError": "int32 a\n", "demo_msgs/msg/Other": "int32 a\n"}
    for name, text in [
        ("demo_msgs/msg/Demo", "Other other\nValueError error\n"),
        ("demo_msgs/msg/ValueError", "Other other\n"),
    ]:
        needed = {one: text for one, text in texts.items() if one != name}
        message = srvgen.define(name, join_full_text(text, needed))()
        message.other.a = "x"
        with pytest.raises(srvgen.FieldError, match=r"^other\.a: expected int32, got 'x'"):
            message._check()


def test_error_names_the_invalid_one_of_several_float32_fields():
    """The check converts them all in one call, which cannot tell which one is invalid."""
    message = srvgen.define("demo_msgs/msg/Demo", "float32 x\nfloat32 y\nfloat32 z\n")(x=1, z=0.1)
    message._check()
    assert (message.x, type(message.x)) == (1.0, float)
    message.y = "far"
    with pytest.raises(srvgen.FieldError, match=r"^y: expected float32, got 'far'"):
        message._check()


@pytest.mark.parametrize("length", [1, 10, 28])
def test_lines_of_a_check_have_at_most_100_columns(length):
    types = ("string<=5", "uint64", "int32[3]", "geometry_msgs/Point[]", "bool")
    fields = "".join(
        f"{kind} {letter}{'x' * length}\n" for kind, letter in zip(types, "abcde", strict=True)
    )
    source = render(parse_msg(fields, "demo_msgs", "Demo"), Hasher(Search([BUNDLED]).load), "").text
    check = source.partition("def _check(")[2]
    assert check
    assert max(map(len, check.splitlines())) <= 100
