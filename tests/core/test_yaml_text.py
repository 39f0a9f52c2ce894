"""YAML from users: any text is read, or refused by the one documented error of its reader."""

from __future__ import annotations

import pytest
import yaml
from hypothesis import example, given
from hypothesis import strategies as st

import srvgen
from taskrpc.cli.shared.messages import Template
from taskrpc.cli.shared.values import build_request
from taskrpc.core import yaml_text
from taskrpc.errors import InvalidRequest
from taskrpc.robot.mapfile import MapError, parse_map
from taskrpc.ros.packages.rclpy._impl.parameters.yaml_parameters import read_file, read_value
from taskrpc.ros.packages.rclpy.parameter import get_parameter_value, parameter_dict_from_yaml_file

LAUGHS = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{level}: &a{level} [{', '.join([f'*a{level - 1}'] * 9)}]\n" for level in range(1, 12)
)
"""A billion values in a kilobyte."""

REFUSED = {
    "2001-99-99": "'2001-99-99' is not a valid timestamp",
    "9" * 5000: f"'{'9' * 40}' is not a valid int",
    f"0x{'f' * 5000}": f"'0x{'f' * 38}' is not a valid int",
    "0x_": "'0x_' is not a valid int",
    "!!int abc": "'abc' is not a valid int",
    "!!float abc": "'abc' is not a valid float",
    "!!bool maybe": "'maybe' is not a valid bool",
    "!!timestamp foo": "'foo' is not a valid timestamp",
    "2001-01-01T00:00:00+99:99": "'2001-01-01T00:00:00+99:99' is not a valid timestamp",
    "[" * 400 + "]" * 400: "nested too deeply",
    "- " * 400: "nested too deeply",
    "&a [*a]": "an alias refers to an anchor that contains it",
    LAUGHS: "aliases repeat more than 100000 values",
    '"\\U00110000"': "there is no such character",
    '"\\ud800"': "half of a surrogate pair is not a character",
    "\ud800": "unacceptable character #xd800: special characters are not allowed",
    "a\0b": "unacceptable character #x0000: special characters are not allowed",
    "!!python/object/apply:os.getcwd []": (
        "could not determine a constructor for the tag"
        " 'tag:yaml.org,2002:python/object/apply:os.getcwd'"
    ),
}

WORDS = [*REFUSED, "!!float 10", "!!set {a}", "!!binary abcd", "&x ", "*x", "<<: ", "{a: 1}"]
TEXTS = (
    st.text()
    | st.text("[]{}:,-!&*?|>'\"%@`#<~= \n\t0123456789abefxouU_.+\\\0\ud800\u00e9")
    | st.lists(st.sampled_from([*WORDS, "a: ", "b: ", "- ", "\n", "  "])).map("".join)
    | st.sampled_from(WORDS).map("/n: {{ros__parameters: {{a: {}}}}}".format)
    | st.sampled_from(WORDS).map("{{a: {}}}".format)
)


@pytest.mark.parametrize(("text", "problem"), REFUSED.items(), ids=lambda text: text[:20])
def test_invalid_yaml_is_refused_with_the_reason(text, problem):
    with pytest.raises(yaml.YAMLError) as caught:
        yaml_text.load(text)
    assert yaml_text.message(caught.value) == problem


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("", None),
        ("!!float 10", 10.0),
        ("{<<: {a: 1, b: 2}, b: 3}", {"a": 1, "b": 3}),
        ("[&x {a: 1}, *x]", [{"a": 1}, {"a": 1}]),
        ('"\\ud83d\\ude00"', "\N{GRINNING FACE}"),
        ("!!binary aGk=", b"hi"),
        ("[" * 99 + "7" + "]" * 99, [7]),
    ],
)
def test_valid_yaml_is_read(text, value):
    found = yaml_text.load(text)
    while text.startswith("[[") and isinstance(found[0], list):
        found = found[0]
    assert found == value


def test_several_documents_may_repeat_each_other():
    text = "---\n".join(["- &a [1]\n- *a\n"] * 50)
    assert len(yaml_text.compose_all(text)) == 50


@given(TEXTS)
@example("{=: 1}")
def test_any_text_gives_a_value_that_can_be_shown_or_a_yaml_error(text):
    try:
        repr(yaml_text.load(text))
    except yaml.YAMLError as error:
        message = yaml_text.message(error)
    else:
        return
    assert message.splitlines() == [message]


REQUESTS = [
    srvgen.load(name).Request
    for name in (
        "example_interfaces/srv/AddTwoInts",
        "my_robot_interfaces/srv/RobotTask",
        "test_msgs/srv/Arrays",
        "nav_msgs/srv/GetPlan",
    )
]


@given(st.sampled_from(REQUESTS), TEXTS, st.sampled_from(["", "a=", "target=", "start.pose="]))
@example(REQUESTS[0], "{a: 2001-99-99}", "")
@example(REQUESTS[0], "0x" + "f" * 60, "a=")
@example(REQUESTS[0], LAUGHS, "")
def test_any_text_is_a_request_or_an_invalid_request(cls, text, field):
    try:
        assert isinstance(build_request(cls, [field + text]), cls)
    except InvalidRequest:
        return


@given(TEXTS)
def test_any_text_is_a_message_to_publish_or_an_invalid_request(text):
    try:
        Template(srvgen.load("std_msgs/msg/Header"), [text]).message()
    except InvalidRequest:
        return


@given(TEXTS)
def test_any_text_is_a_parameter(text):
    get_parameter_value(text)


@given(TEXTS)
def test_any_text_behind_an_argument_is_a_value_or_a_value_error(text):
    for read in (read_value, read_file):
        try:
            read(text)
        except ValueError:
            continue


@given(TEXTS.filter(lambda text: "\ud800" not in text))
@example("[a]")
@example("{1: {ros__parameters: {a: 1}}}")
@example("/n: {ros__parameters: [1]}")
@example("/n: {ros__parameters: 0}")
def test_any_parameter_file_is_read_or_refused(tmp_path_factory, text):
    path = tmp_path_factory.getbasetemp() / "parameters.yaml"
    path.write_text(text, encoding="utf-8", newline="")
    try:
        parameter_dict_from_yaml_file(str(path), use_wildcard=True)
    except (RuntimeError, yaml.YAMLError):
        return


@given(TEXTS)
def test_any_text_is_a_map_or_a_map_error(text):
    try:
        parse_map(text)
    except MapError:
        return
