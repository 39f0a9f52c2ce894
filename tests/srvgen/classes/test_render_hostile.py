"""Hostile definitions: no text runs code, and no name hides a name of Python."""

from __future__ import annotations

import ast

import pytest
from hypothesis import given
from hypothesis import strategies as st

import srvgen
from srvgen.classes.generate import generate
from srvgen.classes.render import render, render_stub
from srvgen.errors import DefinitionError
from srvgen.files.search import BUNDLED
from srvgen.parser import parse_msg, parse_srv
from srvgen.typehash import Hasher
from tests.srvgen.hostile import bundled, define, refused

NASTY = st.text(st.sampled_from("\"'\\{}()[]=;,:%abz_ \0\x1b\u202eé"), max_size=25)


def shape(source: str) -> list[str]:
    """The syntax tree of a module, without its literals."""
    tree = ast.parse(source)
    return [
        "literal" if isinstance(node, ast.Constant) else f"{type(node).__name__} {names(node)}"
        for node in ast.walk(tree)
        # Each line of a long text is one literal, whose place is not compared.
        if not isinstance(node, (ast.Load, ast.Store))
    ]


def names(node: ast.AST) -> list[str]:
    return [str(getattr(node, one)) for one in ("id", "attr", "name", "arg") if hasattr(node, one)]


@given(NASTY, NASTY, NASTY)
def test_no_text_can_put_code_into_a_rendered_module(comment, unit, value):
    """Modules with different texts differ only in their literals."""

    def service(comment: str, unit: str, value: str):
        default = value.replace("=", "")
        text = (
            f"# c{comment}c\nstring a v{default}v # c{comment}c\n"
            f"int32 b # [u{unit.replace(']', '').replace(',', '')}]\n"
            f"string LIMIT=v{value}v\nstring[] many [v{default.replace(',', '')}v]\n---\n"
        )
        return parse_srv(text, "far_msgs", "Ask"), text

    parsed, text = service(comment, unit, value)
    plain, plain_text = service("", "", "")
    assert shape(render(parsed, Hasher(bundled.load), text).text) == shape(
        render(plain, Hasher(bundled.load), plain_text).text
    )
    assert shape(render_stub(parsed)) == shape(render_stub(plain))


def test_text_of_a_definition_cannot_inject_code():
    evil = '"""; import os; os.system("false") #'
    ask = define(f"# {evil}\nstring a {evil[:-2]}\nstring B={evil[:-2]}\n---\n")
    assert ask.Request().a == evil[:-2] == ask.Request.B
    assert evil in (ask.Request.__doc__ or "")
    assert evil in ask._DEFINITION


@pytest.mark.parametrize(
    "name",
    [
        "../../etc/srv/Ask",
        "far_msgs/srv/Ask\n",
        "far_msgs/srv/Ask;import os",
        "far_msgs/srv/__class__",
        "__init__/srv/Ask",
        "far_msgs/os/Ask",
        "far_msgs/srv/Äsk",
        "far msgs/srv/Ask",
    ],
)
def test_invalid_name_is_refused(name):
    with pytest.raises(DefinitionError):
        define("int32 a\n---\n", name)


@pytest.mark.parametrize("package", ["os", "sys", "builtins", "msgspec", "class", "srvgen"])
def test_loaded_package_named_like_a_python_module_hides_nothing(package):
    import os
    import sys

    before = set(sys.modules)
    ask = define("int32 a 3\n---\n", f"{package}/srv/Ask")
    assert ask.Request().a == 3
    assert set(sys.modules) == before
    assert sys.modules["os"] is os


@pytest.mark.parametrize("package", ["os", "msgspec", "class"])
def test_package_named_like_a_python_module_cannot_be_generated(package):
    message = parse_msg("int32 a\n", package, "Thing")
    with pytest.raises(DefinitionError, match=r"expected a.* package"):
        generate({package: [message]}, Fixed(message))


class Fixed:
    def __init__(self, *messages):
        self._messages = {one.full_name: one for one in messages}

    def find(self, name):
        return BUNDLED / name

    def load(self, name):
        return self._messages[name]

    def text(self, name):
        return ""


FIELDS = (
    "self type len cls int str bool float list bytes object property super vars dict msgspec "
    "range any class def import from lambda none true print exec eval get_fields_and_field_types"
)


def test_fields_and_types_may_be_named_like_builtins():
    fields = "".join(f"int32 {name} 7\nstring[] {name}s\n" for name in FIELDS.split())
    ask = define(
        f"{fields}Object object1\nMessage message\nField field\nAny any1\n---\n",
        Object="int32 a 1",
        Message="int32 a 2",
        Field="int32 a 3",
        Any="int32 a 4",
    )
    request = ask.Request()
    request._check()
    assert [getattr(request, f"{one}", None) for one in FIELDS.split()[:-1]] == [7] * len(
        FIELDS.split()[:-1]
    )
    assert (request.object1.a, request.message.a, request.field.a, request.any1.a) == (1, 2, 3, 4)


@pytest.mark.parametrize("name", ["None", "True", "False"])
def test_type_named_like_a_keyword_is_refused(name):
    message = refused(f"{name} a\n---\n", **{name: "int32 a\n"})
    assert message.startswith("expected a type name that is not a keyword of Python")


@given(st.text(max_size=200), st.sampled_from(["int32 a\n---\n", "Inner a\n---\n", ""]))
def test_any_full_text_is_defined_or_refused(tail, head):
    try:
        srvgen.define("far_msgs/srv/Ask", head + tail)
    except DefinitionError:
        return
