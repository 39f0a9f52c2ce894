"""What stands behind `--ros-args` is read as ROS reads it."""

import contextlib
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.ros.packages.rclpy._impl.arguments import (
    _OPTIONS,
    _SWITCHES,
    Arguments,
    RemapKind,
    Remapping,
    RemapRule,
    overrides_of,
    parse,
)
from taskrpc.ros.packages.rclpy.exceptions import RCLInvalidROSArgsError, UnknownROSArgsError


def test_arguments_that_are_not_of_ros_keep_their_order():
    line = ["prog", "-d", "--ros-args", "-r", "__node:=n", "--", "--foo=bar", "--", "x"]
    assert parse(line).rest == ["prog", "-d", "--foo=bar", "--", "x"]


def test_ros_args_may_come_twice():
    line = ["--ros-args", "-p", "a:=1", "--", "mine", "--ros-args", "-p", "b:=2"]
    assert parse(line).parameters == {"/**": {"a": 1, "b": 2}}


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("__node:=other", RemapRule(RemapKind.NODE, "", "other")),
        ("__name:=other", RemapRule(RemapKind.NODE, "", "other")),
        ("talker:__node:=other", RemapRule(RemapKind.NODE, "", "other", "talker")),
        ("__ns:=/", RemapRule(RemapKind.NAMESPACE, "", "/")),
        ("__ns:=/a/b", RemapRule(RemapKind.NAMESPACE, "", "/a/b")),
        ("foo:=bar", RemapRule(RemapKind.TOPIC_OR_SERVICE, "foo", "bar")),
        ("~/x:=/y/z", RemapRule(RemapKind.TOPIC_OR_SERVICE, "~/x", "/y/z")),
        ("n:/x:=~/y", RemapRule(RemapKind.TOPIC_OR_SERVICE, "/x", "~/y", "n")),
        ("rostopic://x:=y", RemapRule(RemapKind.TOPIC, "x", "y")),
        ("n:rosservice:///x:=y", RemapRule(RemapKind.SERVICE, "/x", "y", "n")),
    ],
)
@pytest.mark.parametrize("flag", ["-r", "--remap"])
def test_a_rule_names_what_it_replaces_by_what_and_for_whom(flag, text, rule):
    assert parse(["--ros-args", flag, text]).remaps == [rule]


@pytest.mark.parametrize(
    ("line", "problem"),
    [
        (
            ["-r", "not-a-remap"],
            "Couldn't parse remap rule: '-r not-a-remap'."
            " Error: Expected a rule of the form 'from:=to'",
        ),
        (["-r"], "Couldn't parse trailing -r flag. No remap rule found."),
        (["-r", "*:=x"], "Couldn't parse remap rule: '-r *:=x'. Error: Wildcard '*' is not implem"),
        (
            ["-r", "/a-b:=x"],
            "Couldn't parse remap rule: '-r /a-b:=x'. Error: Expecting token or wi",
        ),
        (
            ["-r", "__ns:=x"],
            "Couldn't parse remap rule: '-r __ns:=x'. Error:"
            " Namespace not remapped to a fully qualified name (found: x)",
        ),
        (["-p", "x"], "Couldn't parse parameter override rule: '-p x'. Error: Expected a rule of"),
        (
            ["-p", "x:="],
            "Couldn't parse parameter override rule: '-p x:='. Error: No value at line",
        ),
        (
            ["-p", "x:=[1, a]"],
            "Couldn't parse parameter override rule: '-p x:=[1, a]'. Error: Sequence should be of"
            " same type. Value type 'string' do not belong at line_num 1",
        ),
        (
            ["--params-file", "nowhere.yaml"],
            "Couldn't parse params file: '--params-file nowhere.yaml'."
            " Error: Error opening YAML file",
        ),
        (["--params-file"], "Couldn't parse trailing --params-file flag. No file path provided."),
        (
            ["--log-level", "loud"],
            "Couldn't parse log level rule: '--log-level loud'."
            " Error: Argument does not use a valid severity level",
        ),
        (["-e", "x"], "Couldn't parse enclave name: '-e x'. Error: Expected an absolute name"),
    ],
)
def test_unreadable_arguments_are_reported_in_the_words_of_ros(line, problem):
    with pytest.raises(RCLInvalidROSArgsError) as caught:
        parse(["--ros-args", *line], failed="failed to initialize rcl")
    assert str(caught.value).startswith(f"failed to initialize rcl: {problem}")


def test_unknown_options_are_named():
    with pytest.raises(UnknownROSArgsError, match=r"\['--my-custom-flag', 'x'\]"):
        parse(["--ros-args", "--my-custom-flag", "x"])
    assert parse(["--ros-args", "--mine"], strict=False).unknown == ["--mine"]


def test_a_rule_outside_of_ros_args_is_read_with_a_warning():
    found = parse(["prog", "chatter:=other", "x:=y z"])
    assert (found.rest, len(found.remaps)) == (["prog", "x:=y z"], 1)
    assert found.warnings == [
        "Found remap rule 'chatter:=other'. This syntax is deprecated."
        " Use '--ros-args --remap chatter:=other' instead."
    ]


def test_levels_and_switches():
    line = "--log-level WARN --log-level rcl:=debug --disable-rosout-logs --enable-stdout-logs"
    line += " --log-config-file f --log-file-name g --enclave /e --disable-external-lib-logs"
    found = parse(["--ros-args", *line.split()])
    assert found == Arguments(
        log_level=30,
        log_levels={"rcl": 10},
        rosout_logs=False,
        stdout_logs=True,
        external_lib_logs=False,
    )


NODES = {
    "/**": {"a": "all", "b": "all"},
    "/ns/robot": {"a": "mine", "group.x": 1, "group.deep.y": [1.5]},
    "/*/robot": {"c": "one"},
    "other": {"a": "other"},
}


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("/ns/robot", {"a": "mine", "b": "all", "group.x": 1, "group.deep.y": [1.5], "c": "one"}),
        ("/robot", {"a": "all", "b": "all"}),
        ("/other", {"a": "other", "b": "all"}),
        ("/x/y/robot", {"a": "all", "b": "all"}),
    ],
)
def test_a_node_gets_what_fits_its_name_and_the_later_wins(name, expected):
    assert overrides_of([NODES], name) == expected


def test_stars_stand_for_one_part_or_any_number():
    parameters = [{"/**/foo/*/bar": {"x": 1}}]
    assert overrides_of(parameters, "/a/b/foo/d/bar") == {"x": 1}
    assert overrides_of(parameters, "/foo/d/bar") == {"x": 1}
    assert overrides_of(parameters, "/foo/bar") == {}


def test_lines_and_files_of_one_command_line_go_by_their_order(tmp_path):
    path = tmp_path / "p.yaml"
    path.write_text("/**:\n  ros__parameters:\n    a: file\n    b: file\n", encoding="utf-8")
    line = ["--ros-args", "-p", "a:=line", "--params-file", str(path), "-p", "b:=line"]
    assert parse(line).parameters == {"/**": {"a": "file", "b": "line"}}


def test_a_parameter_of_a_topic_s_quality_has_the_topic_s_name_in_it():
    found = parse(["--ros-args", "-p", "qos_overrides./a/b.publisher.depth:=5"])
    assert found.parameters == {"/**": {"qos_overrides./a/b.publisher.depth": 5}}


def test_a_name_in_front_makes_a_parameter_one_node_s():
    found = parse(["--ros-args", "-p", "robot:speed:=1.5", "-p", "speed:=0.5"])
    assert overrides_of([found.parameters], "/robot") == {"speed": 0.5}  # as in ROS: the later
    assert found.parameters == {"robot": {"speed": 1.5}, "/**": {"speed": 0.5}}


@given(st.lists(st.text(max_size=12), max_size=6))
def test_no_command_line_makes_it_fall_over(line):
    with contextlib.suppress(RCLInvalidROSArgsError, UnknownROSArgsError):
        assert isinstance(parse(["--ros-args", *line]), Arguments)


def test_the_reference_has_every_option():
    page = Path(__file__).parents[5] / "docs" / "reference" / "ros-arguments.md"
    table = page.read_text(encoding="utf-8").partition("## Options")[2].partition("##")[0]
    rows = re.findall(r"^\| (`-.*?) \|", table, flags=re.M)
    told = {option for row in rows for option in re.findall(r"`(-[^`]*)`", row)}
    assert told == {*_OPTIONS, *_SWITCHES}


def remapping(*rules):
    line = [word for rule in rules for word in ("-r", rule)]
    return Remapping(parse(["--ros-args", *line]).remaps)


@pytest.mark.parametrize(
    ("rule", "before", "after"),
    [
        ("service:=new", "/ns/service", "/ns/new"),
        ("service:=a/new", "/ns/service", "/ns/a/new"),
        ("a/service:=new", "/ns/a/service", "/ns/new"),
        ("service:=/new", "/ns/service", "/new"),
        ("/x:=y", "/x", "/ns/y"),
        ("~/x:=x", "/ns/node/x", "/ns/x"),
        ("service:=new", "/service", "/service"),
        ("serv:=new", "/ns/service", "/ns/service"),
        ("node:service:=new", "/ns/service", "/ns/new"),
        ("other:service:=new", "/ns/service", "/ns/service"),
        ("rosservice://service:=new", "/ns/service", "/ns/new"),
        ("rostopic://service:=new", "/ns/service", "/ns/service"),
    ],
)
def test_a_rule_holds_for_the_expanded_name(rule, before, after):
    assert remapping(rule).service(before, "/ns", "node") == after


def test_the_first_rule_that_fits_is_used():
    assert remapping("x:=a", "x:=b").topic("/x", "/", "node") == "/a"


def test_a_node_gets_another_name_and_namespace():
    rules = remapping("__node:=other", "__ns:=/foo/bar")
    assert rules.node_name("node") == "other"
    assert rules.namespace("/ns", "other") == "/foo/bar"


def test_a_rule_for_one_node_leaves_the_others_alone():
    rules = remapping("mine:__ns:=/foo")
    assert rules.namespace("/ns", "mine") == "/foo"
    assert rules.namespace("/ns", "other") == "/ns"
