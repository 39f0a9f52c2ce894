"""Hostile definitions: no text runs code, exhausts the memory or raises another error."""

from __future__ import annotations

import ast
import time
import tracemalloc

import pytest
from hypothesis import given
from hypothesis import strategies as st

import srvgen
from srvgen.classes.generate import generate
from srvgen.classes.render import render, render_stub
from srvgen.definitions import limits
from srvgen.definitions.lines import join_full_text
from srvgen.errors import DefinitionError
from srvgen.files.dependencies import problems_of
from srvgen.files.search import BUNDLED, Search
from srvgen.parser import parse_msg, parse_srv
from srvgen.typehash import Hasher

bundled = Search([BUNDLED])
EVENT = ("service_msgs/msg/ServiceEventInfo", "builtin_interfaces/msg/Time")


def define(own: str, name: str = "far_msgs/srv/Ask", **needed: str):
    texts = {one: bundled.text(one) for one in EVENT}
    texts |= {f"far_msgs/msg/{one}": text for one, text in needed.items()}
    return srvgen.define(name, join_full_text(own, texts))


def refused(text: str, **needed: str) -> str:
    with pytest.raises(DefinitionError) as caught:
        define(text, **needed)
    return caught.value.message


# --- nothing runs ---------------------------------------------------------------------------------

NASTY = st.text(st.sampled_from("\"'\\{}()[]=;,:%abz_ \0\x1b\u202e\ud800é"), max_size=25)


def shape(source: str) -> list[str]:
    """What a module consists of, but for its literals."""
    tree = ast.parse(source)
    return [
        "literal" if isinstance(node, ast.Constant) else f"{type(node).__name__} {names(node)}"
        for node in ast.walk(tree)
        # Long texts are one literal a line, and their lines are no part of the shape.
        if not isinstance(node, (ast.Load, ast.Store))
    ]


def names(node: ast.AST) -> list[str]:
    return [str(getattr(node, one)) for one in ("id", "attr", "name", "arg") if hasattr(node, one)]


@given(NASTY, NASTY, NASTY)
def test_no_text_can_put_code_into_a_rendered_module(comment, unit, value):
    """Whatever the texts, the modules differ in their literals only."""

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
def test_a_package_with_a_name_of_pythons_hides_nothing_when_it_is_loaded(package):
    import os
    import sys

    before = set(sys.modules)
    ask = define("int32 a 3\n---\n", f"{package}/srv/Ask")
    assert ask.Request().a == 3
    assert set(sys.modules) == before
    assert sys.modules["os"] is os


@pytest.mark.parametrize("package", ["os", "msgspec", "class"])
def test_a_package_with_a_name_of_pythons_cannot_be_generated(package):
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


def test_fields_and_types_named_like_pythons_own_work():
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


# --- nothing grows beyond bounds ------------------------------------------------------------------


@pytest.mark.parametrize(
    "field",
    [
        "uint8[4000000000] x",
        "uint8[1000000000] x",
        "string[4000000000] x",
        "float64[999999999999999999999999] x",
        "geometry_msgs/Pose[1000000000] x",
    ],
)
def test_a_huge_fixed_array_is_refused_and_never_made(field):
    texts = {one: bundled.text(one) for one in EVENT}
    for name in ("Pose", "Point", "Quaternion"):
        texts[f"geometry_msgs/msg/{name}"] = bundled.text(f"geometry_msgs/msg/{name}")
    tracemalloc.start()
    try:
        with pytest.raises(DefinitionError, match="expected at most 67,108,864 bytes") as caught:
            srvgen.define("far_msgs/srv/Ask", join_full_text(f"{field}\n---\n", texts))
        assert tracemalloc.get_traced_memory()[1] < 2**23
    finally:
        tracemalloc.stop()
    assert (caught.value.line, caught.value.source_line) == (1, field)


def test_arrays_inside_arrays_count_by_their_product():
    needed = {f"Level{n}": f"Level{n + 1}[100] x\n" for n in range(1, 6)}
    message = refused("Level1[100] x\n---\n", **needed, Level6="int32 a\n")
    assert message.startswith("expected at most 67,108,864 bytes")


def test_large_bounds_allocate_no_memory():
    ask = define("uint8[<=4000000000] x\nstring<=4000000000 y\n---\n")
    assert len(ask.Request().x) == 0


def test_a_large_array_within_the_bound_is_fine():
    assert len(define("uint8[1000000] x\n---\n").Request().x) == 1_000_000


def test_deeply_nested_types_give_an_error_instead_of_a_recursion_error():
    chain = {f"Link{n}": f"Link{n + 1} x\n" for n in range(400)}
    message = refused("Link0 x\n---\n", **chain, Link400="int32 a\n")
    assert message == "expected at most 64 levels of nested types, got more"


def test_the_deepest_nesting_that_is_allowed_works():
    depth = limits.DEPTH - 2
    chain = {f"Link{n}": f"Link{n + 1} x\n" for n in range(depth)}
    ask = define("Link0 x\n---\n", **chain, **{f"Link{depth}": "int32 a 5\n"})
    inner = ask.Request()
    inner._check()
    while hasattr(inner, "x"):
        inner = inner.x
    assert inner.a == 5


def test_types_of_a_wide_tree_are_built_once():
    """Sixteen layers, each with four of the next: a message of four thousand million parts."""
    layers = {f"Layer{n}": "".join(f"Layer{n + 1} {c}\n" for c in "abcd") for n in range(16)}
    message = refused("Layer0 x\n---\n", **layers, Layer16="int32 a\n")
    assert message.startswith("expected at most 67,108,864 bytes")


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


@given(st.text(max_size=200), st.sampled_from(["int32 a\n---\n", "Inner a\n---\n", ""]))
def test_any_full_text_is_defined_or_refused(tail, head):
    try:
        srvgen.define("far_msgs/srv/Ask", head + tail)
    except DefinitionError:
        return


def test_a_long_gap_after_a_bracket_takes_no_time_beyond_its_length():
    """Three gaps that may each be empty made the time grow with the cube of the length."""
    with pytest.raises(DefinitionError):
        parse_msg("int32[" + " " * 200_000 + "x y\n", "p", "M")
