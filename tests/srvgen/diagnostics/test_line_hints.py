"""One mistake in a name, a value or a line gives one hint that leads to a valid line."""

from __future__ import annotations

import pytest

from tests.srvgen.diagnostics.test_line_errors import problems_of


@pytest.mark.parametrize(
    ("line", "column", "hint"),
    [
        ("x: int32", 1, "the type comes first: int32 x"),
        ("result: bool", 1, "the type comes first: bool result"),
        ("a int32", 1, "the type comes first: int32 a"),
        ("int32 x=", 7, "constants are in capitals: int32 X=0; a field's default has no '='"),
        (
            "int32 count = 3",
            7,
            "constants are in capitals: int32 COUNT=3; a field's default has",
        ),
        (
            "int32 a = 3;",
            7,
            "constants are in capitals: int32 A=3; a field's default has no '='",
        ),
        ("float32 x = 1.0f", 9, "constants are in capitals: float32 X=1.0; a field's default"),
        ("string target<=20", 8, "a bound belongs to the type: string<=20 target"),
        ("string target <= 20", 8, "a bound belongs to the type: string<=20 target"),
        ("int32 X=", 9, "the value is missing"),
        ("int32 = 3", 7, "the name is missing: int32 NAME=3"),
        ("int32 A = 3;", 11, "did you mean 3?"),
        ("int32 A = 3.0", 11, "did you mean 3?"),
        ("float32 a 1.0f", 11, "did you mean 1.0?"),
        ("bool a yes", 8, "did you mean true?"),
        ("int32[3] x = {1,2,3}", 12, "did you mean int32[3] x [1,2,3]?"),
        ("int32[] x (1, 2)", 11, "did you mean [1, 2]?"),
        ("geometry_msgs/Point p = 3", 23, "a message uses the defaults of its own fields"),
        ("const int32 A=3", 1, "remove it: a line with '=' is a constant"),
        ("optional int32 a", 1, "remove it: every field is always present"),
        ("repeated int32 a", 1, "write an array with brackets: int32[] a"),
        ("int32 a b c", 9, "only a default may follow the name; write a second field on its own"),
        ("int32 a,b", 8, "write each on its own line: int32 a, then int32 b"),
        ("int32 a; bool b", 8, "write each on its own line: int32 a, then bool b"),
        ("int32 a;", 8, "remove what follows the name: int32 a"),
        ("int32 a; // why", 8, "remove what follows the name: int32 a"),
        ("int32 a // why", 9, "write comments with '#'"),
        ("int32 a 3 // why", 9, "write comments with '#'"),
        ("/* why */", 1, "write comments with '#'"),
        ("// why", 1, "write comments with '#'"),
        ('"""', 1, "write comments with '#'"),
        ("std_msgs/String", 1, "the name is missing: std_msgs/String string"),
        ("string<=5[]", 1, "the name is missing: string<=5[] value"),
        (
            "message Foo {",
            1,
            "a definition contains only fields and constants; remove this line",
        ),
        ("class Foo:", 1, "a definition contains only fields and constants; remove this line"),
        ("}", 1, "definitions have no enclosing brackets; remove this line"),
        ("request:", 1, "sections have no titles, only a line --- between them"),
        ("\tint32 a", 1, "only comments may be indented"),
        ("---", 1, "a message has one section, a service (.srv) two, an action (.action) three"),
        ("----", 1, "a message has one section"),
        ("-- -", 1, "a message has one section"),
        ("___", 1, "a message has one section"),
        ("===", 1, "a message has one section"),
        ("-- why", 1, "write comments with '#'"),
        ("string a 'it's'", 13, "write \\' for a quotation mark in the text"),
    ],
)
def test_mistake_in_a_line_is_one_error_with_a_hint(line, column, hint):
    (problem,) = problems_of(f"int32 before\n{line}\nint32 after\n")
    assert (problem.line, problem.column) == (2, column)
    assert problem.hint.startswith(hint) if hint else not problem.hint
