"""The parser: the model of valid texts, the errors of invalid ones, and random texts."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from srvgen.definitions import limits
from srvgen.definitions.model import Constant, Field, FieldType
from srvgen.diagnostics import line_errors
from srvgen.diagnostics.line_errors import errors_in_line
from srvgen.errors import DefinitionError, DefinitionErrors, InvalidText
from srvgen.parser import parse_action, parse_msg, parse_srv

SERVICE = """\
# Adds.
# Both are [m].

int64 a            # the first
int64 b 5  # the second
           # of two
uint8 MOST=0x10
---
# A sum.
float64[<=3] sum [1, 2.5]
"""


def test_a_service_keeps_fields_constants_comments_units_and_positions():
    service = parse_srv(SERVICE, "my_msgs", "Add")
    assert service.full_name == "my_msgs/srv/Add"
    assert service.request.full_name == "my_msgs/srv/Add_Request"
    assert service.request.comment == ("Adds.", "Both are.")
    assert service.request.unit == "m"
    assert service.request.fields == (
        Field("a", FieldType("int64"), None, ("the first",), None, 4, 7),
        Field("b", FieldType("int64"), 5, ("the second", "of two"), None, 5, 7),
    )
    assert service.request.constants == (Constant("MOST", "uint8", 16, (), None, 7, 7),)
    kind = FieldType("float64", is_array=True, array_size=3, is_upper_bound=True)
    assert service.response.fields == (Field("sum", kind, (1.0, 2.5), (), None, 10, 14),)
    assert service.response.comment == ("A sum.",)


def test_a_relative_type_belongs_to_the_same_package_and_names_of_sections_follow_the_kind():
    action = parse_action("Point goal\n---\n---\nother_msgs/Point[] at\n", "my_msgs", "Go")
    assert action.goal.fields[0].type == FieldType("Point", "my_msgs")
    assert action.result.fields == ()
    assert str(action.feedback.fields[0].type) == "other_msgs/Point[]"
    assert action.feedback.full_name == "my_msgs/action/Go_Feedback"


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r", "\v", "\f", "\u2028"])
def test_every_line_end_of_the_official_parser_ends_a_line(end):
    message = parse_msg(f"int32 a{end}int32\tb  {end}", "my_msgs", "Two")
    assert [field.name for field in message.fields] == ["a", "b"]


@pytest.mark.parametrize(
    ("text", "line", "column", "shown"),
    [
        ("int32 a\n# \ud800\n", 2, 3, "# \ufffd"),
        ("int32 a\r\nstring é\udfff 'x'\n", 2, 9, "string é\ufffd"),
        ("\udc80", 1, 1, "\ufffd"),
        ("int32 a\u2028\tstring b '\U0001f600\ud83d'", 2, 13, "\tstring b '\U0001f600\ufffd"),
    ],
)
def test_lone_surrogate_is_refused_with_its_place(text, line, column, shown):
    for parse, rest in ((parse_msg, ""), (parse_srv, "\n---\n"), (parse_action, "\n---\n---\n")):
        with pytest.raises(DefinitionError, match="got a lone surrogate \\(U\\+D") as caught:
            parse(text + rest, "my_msgs", "Bad", path="Bad")
        error = caught.value
        assert (error.path, error.line, error.column) == ("Bad", line, column)
        assert error.source_line == shown


def test_a_hash_begins_a_comment_even_inside_quotes():
    message = parse_msg('string x "a#b"', "my_msgs", "Text")
    assert message.fields[0].default == '"a'
    assert message.fields[0].comment == ('b"',)


def test_a_python_keyword_is_a_good_field_name():
    assert parse_msg("int32 class", "my_msgs", "Text").fields[0].name == "class"


def test_every_problem_of_a_file_is_found_in_one_run():
    with pytest.raises(DefinitionErrors) as caught:
        parse_srv("int a\nint8 B\nint8 c 200\n", "my_msgs", "Wrong", path="Wrong.srv")
    places = [(one.line, one.column) for one in caught.value.problems]
    assert places == [(1, 1), (2, 6), (3, 8), (3, 11)]
    assert str(caught.value).count("Wrong.srv:") == 4


@pytest.mark.parametrize(
    ("package", "name", "hint"),
    [
        ("My-Package", "Name", "rename the package to my_package"),
        ("my__msgs", "Name", "rename the package to my_msgs"),
        ("my_msgs", "add_two", "rename the file to AddTwo.srv"),
        ("my_msgs", "AddTwo_Response_Request", "rename the file to AddTwoResponseRequest.srv"),
    ],
)
def test_invalid_package_and_type_names_give_a_suggestion(package, name, hint):
    with pytest.raises(DefinitionError) as caught:
        parse_srv("---", package, name)
    assert caught.value.hint == hint


ALPHABET = st.sampled_from(list("ab_AZ09 #=-[]<>/\"'\\,.\t\n\r\v\u2028\xa0\ufeff—•“é\0+"))
WORDS = st.sampled_from(
    "int32 string bool float64 time wstring<=3 [<=2] [3] --- # = x FOO [1,2] 'a' \" a/X \n".split(
        " "
    )
)
GARBAGE = st.one_of(
    st.text(), st.text(ALPHABET), st.lists(WORDS).map(" ".join), st.lists(WORDS).map("".join)
)


def refusal(parse, text, package="my_msgs", name="Any"):
    try:
        parse(text, package, name)
    except DefinitionError as error:
        return str(error)
    return None


@given(GARBAGE)
def test_any_text_is_parsed_or_refused_with_a_definition_error(text):
    for parse in (parse_msg, parse_srv, parse_action):
        first = refusal(parse, text)
        assert first != ""
        assert refusal(parse, text) == first


@given(st.text(), st.text())
def test_any_name_is_accepted_or_refused_with_a_definition_error(package, name):
    for parse, text in ((parse_msg, ""), (parse_srv, "---"), (parse_action, "---\n---")):
        assert refusal(parse, text, package, name) != ""


def test_lines_beyond_the_last_problem_that_is_reported_are_not_explained(monkeypatch):
    explained: list[str] = []

    def mistakes(code: str, package: str) -> list[InvalidText]:
        explained.append(code)
        return errors_in_line(code, package)

    monkeypatch.setattr(line_errors, "errors_in_line", mistakes)
    with pytest.raises(DefinitionErrors) as caught:
        parse_srv("bad\n" * limits.PROBLEMS + "---\n" + "bad\n" * 5_000, "demo_msgs", "Ask")
    assert len(explained) == len(caught.value.problems) == limits.PROBLEMS


@pytest.mark.parametrize(
    ("parse", "name"),
    [
        (parse_srv, "Foo_Request"),
        (parse_srv, "Foo_Response"),
        (parse_action, "Foo_Goal"),
        (parse_action, "Foo_Result"),
        (parse_action, "Foo_Feedback"),
    ],
)
def test_name_that_collides_with_a_derived_type_is_refused(parse, name):
    text = "---\n" if parse is parse_srv else "---\n---\n"
    with pytest.raises(DefinitionError, match="expected a type name"):
        parse(text, "pkg", name)
