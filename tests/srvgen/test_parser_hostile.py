"""Hostile definitions: no text runs code, exhausts the memory or raises another error."""

from __future__ import annotations

import time

import pytest

from srvgen.definitions import limits
from srvgen.errors import DefinitionError
from srvgen.files.dependencies import problems_of
from srvgen.parser import parse_msg, parse_srv
from tests.srvgen.hostile import define, refused


@pytest.mark.real_time
def test_each_of_many_connected_types_is_hashed_once():
    """Each of 200 types refers to each of the next layer: 6,400 references, 2.5 million ways."""
    layers = {
        f"Part{n}x{i}": "".join(f"Part{n + 1}x{j}[] f{j}\n" for j in range(40))
        if n < 4
        else "int8 a"
        for n in range(5)
        for i in range(40)
    }
    started = time.process_time()
    assert define("Part0x0 x\n---\n", **layers).Request().x.f0 == []
    assert time.process_time() - started < 4


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("int32 a # " + "x" * 2**20 + "\n---\n", "at most 1,048,576 characters"),
        ("".join(f"int8 a{n}\n" for n in range(10_001)) + "---\n", "at most 10,000 fields"),
        ("uint8[] a [" + "1," * 10_000 + "1]\n---\n", "at most 10,000 fields"),
        ("uint8 a " + "9" * 5000 + "\n---\n", "expected a whole number"),
        ("uint8[" + "9" * 5000 + "] a\n---\n", "expected a whole number"),
        ("float64 a " + "(" * 100_000 + "\n---\n", "expected a number"),
        ("int32[] a [" + "[" * 100_000 + "]\n---\n", "expected a whole number"),
    ],
    ids=["length", "fields", "elements", "digits", "size", "parentheses", "brackets"],
)
def test_exceeded_limit_is_one_error(text, problem):
    assert problem in refused(text)


@pytest.mark.parametrize("text", ["int32 a # \ud800\n---\n", "string a \ud800\n---\n"])
def test_lone_surrogate_in_a_text_from_another_program_is_refused(text):
    assert "got a lone surrogate (U+D800)" in refused(text)
    # A service class keeps its whole text, also the parts that it does not need.
    assert "got a lone surrogate (U+D800)" in refused("int32 a\n---\n", Part=text)


def test_too_many_definitions_are_refused():
    message = refused("int32 a\n---\n", **{f"Part{n}": "int32 a\n" for n in range(500)})
    assert message == "expected at most 500 nested definitions, got 502"


def test_ten_thousand_fields_are_loaded():
    ask = define("".join(f"int8 a{n}\n" for n in range(9_000)) + "---\n")
    assert len(ask.Request._FIELDS) == 9_000


@pytest.mark.parametrize(
    "text",
    [
        "# " + " " * 400_000 + "x [\nint32 a\n---\n",
        "# " + "[" * 400_000 + "\nint32 a\n---\n",
        "# " + "[a" * 200_000 + ",\nint32 a\n---\n",
        "string[] a [" + '"",' * 9_000 + "]\n---\n",
        "string[] a [" + " " * 400_000 + "]\n---\n",
        "bad\n" * 100_000 + "---\n",
        "- " * 200_000 + "\n---\n",
        "int32 a" + "_a" * 200_000 + "!\n---\n",
        "\u00a0" * 100_000 + "\n---\n",
    ],
    ids=["spaces", "open", "commas", "strings", "blank", "lines", "dashes", "name", "nbsp"],
)
@pytest.mark.real_time
def test_long_invalid_text_is_parsed_in_linear_time(text):
    started = time.process_time()
    problems: list[DefinitionError] = []
    try:
        parse_srv(text, "far_msgs", "Ask")
    except DefinitionError as error:
        problems = problems_of(error)
    assert len(problems) <= limits.PROBLEMS
    assert time.process_time() - started < 2.5


def test_a_long_gap_after_a_bracket_takes_linear_time():
    """Three gaps that may each be empty made the time grow with the cube of the length."""
    with pytest.raises(DefinitionError):
        parse_msg("int32[" + " " * 200_000 + "x y\n", "p", "M")
