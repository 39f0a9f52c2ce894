"""Names are checked and expanded by ROS's rules, with a caret under what is wrong."""

import pytest

from taskrpc.ros.packages.rclpy import exceptions
from taskrpc.ros.packages.rclpy.expand_topic_name import expand_topic_name
from taskrpc.ros.packages.rclpy.topic_or_service_is_hidden import topic_or_service_is_hidden
from taskrpc.ros.packages.rclpy.validate_full_topic_name import validate_full_topic_name
from taskrpc.ros.packages.rclpy.validate_namespace import validate_namespace
from taskrpc.ros.packages.rclpy.validate_node_name import validate_node_name
from taskrpc.ros.packages.rclpy.validate_topic_name import validate_topic_name


@pytest.mark.parametrize("name", ["chatter", "{node}/chatter", "~/chatter", "{anything}/x", "a//b"])
def test_a_relative_name_may_have_substitutions(name):
    assert validate_topic_name(name)


@pytest.mark.parametrize(
    ("check", "name", "kind", "text"),
    [
        (validate_node_name, "a?", exceptions.InvalidNodeNameException, "must not contain char"),
        (validate_node_name, "", exceptions.InvalidNodeNameException, "must not be empty"),
        (validate_namespace, "", exceptions.InvalidNamespaceException, "must not be empty"),
        (validate_namespace, "x", exceptions.InvalidNamespaceException, "must be absolute"),
        (validate_namespace, "/x?", exceptions.InvalidNamespaceException, "must not contain"),
        (validate_topic_name, "/x?", exceptions.InvalidTopicNameException, "must not contain"),
        (validate_topic_name, "x/4t", exceptions.InvalidTopicNameException, "start with a number"),
        (validate_full_topic_name, "x", exceptions.InvalidTopicNameException, "must be absolute"),
        (validate_full_topic_name, "/{x}", exceptions.InvalidTopicNameException, "'_', or '/':"),
        (validate_full_topic_name, "/x/", exceptions.InvalidTopicNameException, "end with a '/':"),
    ],
)
def test_a_wrong_name_is_refused_with_its_rule(check, name, kind, text):
    with pytest.raises(kind, match=text):
        check(name)


@pytest.mark.parametrize("check", [validate_topic_name, validate_full_topic_name])
def test_a_services_name_is_called_so(check):
    with pytest.raises(exceptions.InvalidServiceNameException) as caught:
        check("/bad name", is_service=True)
    assert str(caught.value).startswith("Invalid service name: topic name must not contain")
    assert str(caught.value).endswith(":\n  '/bad name'\n       ^")


@pytest.mark.parametrize(
    "check", [validate_node_name, validate_namespace, validate_topic_name, validate_full_topic_name]
)
def test_what_is_no_text_is_refused(check):
    with pytest.raises(TypeError, match="expected a"):
        check(7)


@pytest.mark.parametrize(
    ("name", "namespace", "whole"),
    [
        ("chatter", "/ns", "/ns/chatter"),
        ("chatter", "/", "/chatter"),
        ("~/chatter", "/ns", "/ns/node/chatter"),
        ("~/chatter", "/", "/node/chatter"),
        ("/chatter", "/ns", "/chatter"),
        ("{node}/x", "/ns", "/ns/node/x"),
    ],
)
def test_a_name_is_expanded_for_a_node(name, namespace, whole):
    assert expand_topic_name(name, "node", namespace) == whole


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("x", "bad?", "/ns"), "node name 'bad\\?' is invalid: node name must not contain"),
        (("x", "node", ""), "node namespace '' is invalid: namespace must not be empty"),
        (("x", "node", "ns"), "node namespace 'ns' is invalid: namespace must be absolute"),
        (("x?", "node", "/ns"), "topic name 'x\\?' is invalid: topic name must not contain"),
        (("x/{bad}", "node", "/ns"), "unknown substitution"),
    ],
)
def test_what_cannot_be_expanded_is_a_value_error(arguments, text):
    with pytest.raises(ValueError, match=text) as caught:
        expand_topic_name(*arguments)
    assert type(caught.value) is ValueError


@pytest.mark.parametrize("arguments", [(5, "node", "/"), ("x", 5, "/"), ("x", "node", None)])
def test_only_texts_are_expanded(arguments):
    with pytest.raises(TypeError, match="expected a "):
        expand_topic_name(*arguments)


def test_a_token_that_begins_with_an_underscore_hides_a_name():
    assert topic_or_service_is_hidden("/a/_b/c")
    assert topic_or_service_is_hidden("_a")
    assert not topic_or_service_is_hidden("/a_/b_c")
