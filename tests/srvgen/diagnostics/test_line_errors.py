"""One mistake is one error at its first character, with a hint that leads to a valid line."""

from __future__ import annotations

import pytest

from srvgen.definitions.model import PRIMITIVES
from srvgen.definitions.names import is_one_typo
from srvgen.diagnostics.type_hints import _COMMON_MESSAGES, replacements
from srvgen.errors import DefinitionError
from srvgen.files.reading import parse_definition
from srvgen.files.search import Search


def problems_of(text, kind="msg"):
    try:
        parse_definition(text, "my_msgs", kind, "Thing")
    except DefinitionError as error:
        return getattr(error, "problems", [error])
    return []


@pytest.mark.parametrize(
    ("line", "column", "hint"),
    [
        ("itn32 a", 1, "did you mean int32?"),
        ("float46 a", 1, "did you mean float64?"),
        ("int65[3] a", 1, "did you mean int64?"),
        ("int36 a", 1, "did you mean int16 or int32?"),
        ("strng a", 1, "did you mean string?"),
        ("boolean a", 1, "did you mean bool?"),
        ("uint a", 1, "did you mean uint32?"),
        ("unsigned int a", 1, "did you mean uint32?"),
        ("unsigned long a", 1, "did you mean uint64?"),
        ("long long a", 1, "did you mean int64?"),
        ("float a", 1, "did you mean float32?"),
        (
            "int128 a",
            1,
            "there are int8 to int64 and uint8 to uint64",
        ),
        ("int32_t a", 1, "did you mean int32?"),
        ("u8 a", 1, "did you mean uint8?"),
        ("int[] a", 1, "did you mean int32?"),
        ("vector<int> a", 1, "did you mean int32[]?"),
        ("std::vector<double> a", 1, "did you mean float64[]?"),
        ("std::array<float,3> a", 1, "did you mean float32[3]?"),
        ("int32[N] a", 7, "the size is a number above 0; without a size the array has any length"),
        ("int32[<3] a", 7, "an array of at most 3 is written int32[<=3]"),
        ("List[str] a", 6, "did you mean string[]?"),
        ("list a", 1, "write an array as the type of its elements with brackets, such as int32[]"),
        ("dict a", 1, "define a message (.msg) with these fields and write its name here"),
        ("string<10 a", 1, "did you mean string<=10?"),
        ("string<=10> a", 9, ""),
        ("string <= 5 a", 1, "did you mean string<=5?"),
        ("string[ ] q", 1, "did you mean string[]?"),
        ("int32 [3] a", 1, "did you mean int32[3]?"),
        ("int32 [<=3] a", 1, "did you mean int32[<=3]?"),
        ("int32[ <= 3 ] a", 1, "did you mean int32[<=3]?"),
        (
            "int32<=5 a",
            1,
            "only strings have such a bound; write the bound of an array in brackets",
        ),
        ("pose p", 1, "did you mean geometry_msgs/Pose?"),
        ("geometry_msgs/point p", 15, "did you mean geometry_msgs/Point?"),
        ("geometry-msgs/Point p", 9, "did you mean geometry_msgs/Point?"),
        ("geometry_msgs/Point.msg p", 15, "did you mean geometry_msgs/Point?"),
        ("std_msgs.msg.String s", 1, "in a definition the type is written std_msgs/String"),
        ("std_msgs/msg/String s", 1, "in a definition the type is written std_msgs/String"),
        ("std_msgs::String s", 1, "did you mean std_msgs/String?"),
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
def test_one_mistake_is_one_error_with_a_hint(line, column, hint):
    (problem,) = problems_of(f"int32 before\n{line}\nint32 after\n")
    assert (problem.line, problem.column) == (2, column)
    assert problem.hint.startswith(hint) if hint else not problem.hint


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


def test_hints_to_bundled_types_are_correct():
    search = Search()
    for name in _COMMON_MESSAGES.values():
        assert not search.is_missing(name.replace("/", "/msg/"))
    for primitive in PRIMITIVES - {"wstring"}:
        _, wrapped = replacements(primitive.capitalize())
        assert not search.is_missing(wrapped.replace("/", "/msg/"))


@pytest.mark.parametrize(
    ("name", "offered"),
    [
        ("Int32", "int32 or std_msgs/Int32"),
        ("UInt8", "uint8 or std_msgs/UInt8"),
        ("String", "string or std_msgs/String"),
        ("Double", "float64"),
        ("Pose", "geometry_msgs/Pose or turtlesim/Pose"),
        ("Pont", "geometry_msgs/Point"),
    ],
)
def test_hint_offers_the_package_that_has_the_missing_type(name, offered, tmp_path):
    path = tmp_path / "my_msgs" / "msg" / "Thing.msg"
    path.parent.mkdir(parents=True)
    path.write_text(f"{name} a\n")
    with pytest.raises(DefinitionError) as caught:
        Search([tmp_path]).with_dependencies("my_msgs/msg/Thing")
    assert caught.value.hint == f"did you mean {offered}?"


@pytest.mark.parametrize("word", ["int", "nt32", "int322", "imt32", "itn32", "nit32", "int23"])
def test_missing_extra_wrong_or_swapped_letter_is_one_typo(word):
    assert is_one_typo(word, "int32") == is_one_typo("int32", word) == (word != "int")
    assert not is_one_typo(word, word)
