"""Remapping replaces names as a whole, once both sides are expanded."""

import pytest

from taskrpc.rclpy._impl.arguments import parse
from taskrpc.rclpy._impl.remapping import Remapping


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
