"""A misspelt type or a type of another language gives one hint that leads to a valid type."""

from __future__ import annotations

import pytest

from srvgen.definitions.model import PRIMITIVES
from srvgen.diagnostics.type_hints import _COMMON_MESSAGES, replacements
from srvgen.errors import DefinitionError
from srvgen.files.search import Search
from tests.srvgen.diagnostics.test_line_errors import problems_of


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
    ],
)
def test_invalid_type_is_one_error_with_a_hint(line, column, hint):
    (problem,) = problems_of(f"int32 before\n{line}\nint32 after\n")
    assert (problem.line, problem.column) == (2, column)
    assert problem.hint.startswith(hint) if hint else not problem.hint


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
