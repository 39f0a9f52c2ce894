"""Valid values that are probably mistakes give a warning and no error."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import pytest

from tests.srvgen.sample_definitions import put, put_all

pytestmark = pytest.mark.usefixtures("workspace")


@pytest.fixture
def check(run):
    return partial(run, "check")


def warned(check, line: str) -> list[str]:
    path = put("my_msgs/msg/Odd", f"{line}\n")
    code, out, err = check("my_msgs")
    assert code == 0
    assert out.startswith("1 definition, no problems")
    heads = [one for one in err.splitlines() if one.startswith(str(path))]
    return [one.removeprefix(f"{path}:") for one in heads]


def test_comment_that_begins_inside_quotes_gives_a_warning(check):
    assert warned(check, 'string x "a#b"') == [
        "1:12: warning: expected the text to end before '#', got '\"a' as the whole text: "
        "'#' begins a comment, even inside quotes"
    ]
    assert warned(check, "string LIMIT='a#b'")


@pytest.mark.parametrize(
    ("line", "place", "words"),
    [
        ("string x \u201cabc\u201d", "1:10", "a left double quotation mark"),
        ("string x a\u00a0b", "1:11", "a no-break space"),
        ("string x hello // world", "1:16", "got '//' in the value"),
        ("wstring NAME=it\u2019s", "1:16", "a right single quotation mark"),
    ],
)
def test_characters_of_a_word_processor_give_a_warning(check, line, place, words):
    (first, *_) = warned(check, line)
    assert first.startswith(f"{place}: warning: expected ")
    assert words in first


@pytest.mark.parametrize(
    "line",
    [
        'string x "a" # say "b"',
        "string x it's # don't",
        "string x http://example.org",
        'string x "a // b"',
        "int32 a 3 # no",
        'string x ""',
        "# \u201cquoted\u201d",
    ],
)
def test_plain_value_gives_no_warning(check, line):
    assert warned(check, line) == []


def test_warnings_do_not_fail_and_are_counted(check):
    put("my_msgs/msg/Odd", "string x \u201cabc\nstring y \u201eabc\n")
    code, out, _ = check("my_msgs")
    assert (code, out) == (0, "1 definition, no problems, 2 warnings\n")


def test_json_output_has_warnings_under_their_own_key(check):
    path = put("my_msgs/msg/Odd", "string x \u201cabc\n")
    code, _, err = check("my_msgs", "--json")
    (line,) = err.splitlines()
    told = json.loads(line)
    assert (code, told["warning"], told["path"]) == (0, "DefinitionWarning", str(path))
    assert "error" not in told


MANIFEST = "<package format='3'><name>my_msgs</name>{}</package>"


def test_undeclared_dependency_gives_a_warning_at_its_first_field(check):
    path = put(
        "my_msgs/srv/Ask", "int32 a\ngeometry_msgs/Pose p\n---\ngeometry_msgs/Point q\nInner i\n"
    )
    put("my_msgs/msg/Inner", "std_msgs/Header header\n")
    put_all({"my_msgs/package.xml": MANIFEST.format("<depend>std_msgs</depend>")}, Path())
    code, _, err = check("my_msgs")
    assert code == 0
    assert err == (
        f"{path}:2:1: warning: expected package.xml to declare geometry_msgs, "
        "which this field needs\n"
        "    geometry_msgs/Pose p\n"
        "    ^\n"
        "  hint: add <depend>geometry_msgs</depend>\n"
    )


@pytest.mark.parametrize("tag", ["depend", "exec_depend", "build_depend", "run_depend"])
def test_every_way_to_declare_a_dependency_counts(check, tag):
    put("my_msgs/msg/Inner", "std_msgs/Header header\n")
    put_all({"my_msgs/package.xml": MANIFEST.format(f"<{tag}> std_msgs </{tag}>")}, Path())
    assert check("my_msgs")[2] == ""


def test_package_without_package_xml_gives_no_warning(check):
    put("my_msgs/msg/Inner", "std_msgs/Header header\n")
    assert check("my_msgs") == (0, "1 definition, no problems\n", "")


def test_invalid_package_xml_gives_one_warning(check):
    put("my_msgs/msg/Inner", "std_msgs/Header header\n")
    put("my_msgs/msg/Other", "int32 a\n")
    put_all({"my_msgs/package.xml": "<package>"}, Path())
    code, _, err = check("my_msgs")
    manifest = Path("my_msgs/package.xml").resolve()
    assert (code, err.count("warning:")) == (0, 1)
    assert f"{manifest}:1:1: warning: expected a package manifest in XML" in err


def test_circular_packages_are_an_error_although_their_types_are_not_circular(check):
    put("a_msgs/msg/A", "b_msgs/B b\n")
    put("a_msgs/msg/C", "int32 c\n")
    put("b_msgs/msg/B", "a_msgs/C c\n")
    code, _, err = check("a_msgs", "b_msgs")
    assert code == 1
    assert err == "expected packages without circular dependencies, got a_msgs → b_msgs → a_msgs\n"


@pytest.mark.parametrize(
    "line",
    ["float32 a 1e39", "float32 A=-1e39", "float32[] a [1.0, 1e39]", "float32[2] a [0, 1e39]"],
)
def test_number_that_is_too_large_for_float32_gives_a_warning(check, line):
    assert "expected a float32 up to 3.402823e+38" in "".join(warned(check, line))


@pytest.mark.parametrize(
    "line", ["float32 a 3.4028234663852886e38", "float32 a inf", "float64 a 1e39"]
)
def test_number_within_the_range_of_its_type_gives_no_warning(check, line):
    assert warned(check, line) == []
