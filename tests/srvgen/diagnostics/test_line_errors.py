"""One mistake is one error at its first character, with a hint that leads to a valid line."""

from __future__ import annotations

import pytest

from srvgen.errors import DefinitionError
from srvgen.files.reading import parse_definition


def problems_of(text, kind="msg"):
    try:
        parse_definition(text, "my_msgs", kind, "Thing")
    except DefinitionError as error:
        return getattr(error, "problems", [error])
    return []


def test_indented_line_has_its_other_errors_reported_too():
    indented, typed = problems_of("    int a\n")
    assert (indented.column, indented.hint) == (1, "only comments may be indented")
    assert (typed.column, typed.hint) == (5, "did you mean int32?")


@pytest.mark.parametrize("line", ["----", "-- -", "___", "===", "\u2014", " --- "])
def test_misspelt_separator_is_one_error(line):
    (problem,) = problems_of(f"int32 a\n{line}\nint32 b\n", "srv")
    assert problem.hint == "write exactly three hyphens and nothing else on the line"


@pytest.mark.parametrize("text", ["", "int32 a\n", "int32 a\n---\n---\nint32 b\n"])
def test_a_wrong_number_of_sections_is_one_error(text):
    (problem,) = problems_of(text, "srv")
    assert problem.hint


@pytest.mark.parametrize("text", ["int32\ta\t3\n", "int32 a\r\nint32 b\r\n", "#include <x>\n"])
def test_tabs_and_windows_line_ends_are_valid(text):
    assert not problems_of(text)
