"""Literals and docstrings in rendered source: safe against any text."""

from __future__ import annotations

import ast

from hypothesis import given
from hypothesis import strategies as st

from srvgen.classes.render import render
from srvgen.classes.render_expressions import definition_literal, docstring, text_literal
from srvgen.files.search import BUNDLED, Search
from srvgen.parser import parse_msg
from srvgen.typehash import Hasher

bundled = Search([BUNDLED])


def rendered(text: str) -> str:
    return render(parse_msg(text, "demo_msgs", "Demo"), Hasher(bundled.load), "").text


@given(st.text())
def test_a_string_literal_gives_back_the_text(text):
    assert ast.literal_eval(text_literal(text)) == text


@given(st.text())
def test_a_definition_literal_gives_back_the_text(text):
    assert ast.literal_eval(definition_literal(text)) == text


@given(st.lists(st.text(st.characters(exclude_characters="\n\r")), min_size=1, max_size=4))
def test_comment_becomes_a_docstring_and_is_never_executed(lines):
    source = "class C:\n" + "\n".join(docstring(lines, "    "))
    tree = ast.parse(source)
    (statement,) = tree.body[0].body  # type: ignore[attr-defined]
    said = statement.value.value.split("\n")
    assert [line.strip() for line in said if line.strip()] == [
        line.strip() for line in lines if line.strip()
    ]


@given(st.lists(st.text(alphabet="\"\\#ab \u202e\u00e9'", max_size=12), max_size=4))
def test_no_comment_can_leave_its_docstring(comments):
    text = "".join(f"# {comment}\n" for comment in comments) + "int32 a\n"
    text += "".join(f"# {comment}\n" for comment in comments) + "int32 b  # " + "".join(comments)
    body = ast.parse(rendered(text)).body
    assert [type(node).__name__ for node in body] == ["Expr", "ImportFrom", "ClassDef"]


def test_unprintable_characters_are_escaped():
    """Bidirectional marks could make a definition look different in an editor."""
    source = rendered("# a\u202eb\nstring s \u202e\n")
    assert "\u202e" not in source
    assert source.count("\\u202e") == 3
