"""Names follow ROS's rules, and a wrong one is shown with a caret at the wrong character."""

import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.core.names import (
    check_namespace,
    check_node_name,
    expand,
    fully_qualified,
    is_hidden,
    relative,
)
from taskrpc.errors import InvalidName

CHARACTERS = (
    "topic name must not contain characters other than alphanumerics, '_', '~', '{', or '}'"
)
EMPTY = "topic name must not be empty string"
SLASH_AT_END = "topic name must not end with a forward slash"
DIGIT = "topic name token must not start with a number"
BRACES = "topic name must not have unmatched (unbalanced) curly braces '{}'"
TILDE = "topic name must not have tilde '~' unless it is the first character"
TILDE_ALONE = "topic name must not have a tilde '~' that is not followed by a forward slash '/'"
SUBSTITUTION = "substitution name must not contain characters other than alphanumerics or '_'"
SUBSTITUTION_DIGIT = "substitution name must not start with a number"
REPEATED = "topic name must not contain repeated '/'"


def unknown(what):
    return f"unknown substitution '{what}', expected {{node}} or {{ns}}"


BAD_SERVICE_NAMES = [
    ("", 0, EMPTY),
    ("foo/", 3, SLASH_AT_END),
    ("/", 0, SLASH_AT_END),
    ("123", 0, DIGIT),
    ("123abc", 0, DIGIT),
    ("foo/123bar", 4, DIGIT),
    ("/1", 1, DIGIT),
    (" ", 0, CHARACTERS),
    ("foo bar", 3, CHARACTERS),
    ("add-two-ints", 3, CHARACTERS),
    ("/a.b", 2, CHARACTERS),
    ("größe", 2, CHARACTERS),
    ("a\n", 1, CHARACTERS),
    ("٣", 0, CHARACTERS),
    ("/~", 1, TILDE),
    ("foo~", 3, TILDE),
    ("foo~/bar", 3, TILDE),
    ("foo/~bar", 4, TILDE),
    ("foo/~/bar", 4, TILDE),
    ("a/{n~}", 4, TILDE),
    ("~foo", 1, TILDE_ALONE),
    ("~~", 1, TILDE),
    ("~{ns}", 1, TILDE_ALONE),
    ("foo/bar}/baz", 7, BRACES),
    ("}foo", 0, BRACES),
    ("foo/{bar", 4, BRACES),
    ("{", 0, BRACES),
    ("{$}", 1, SUBSTITUTION),
    ("{{bar}_baz}", 1, SUBSTITUTION),
    ("foo/{bar/baz}", 8, SUBSTITUTION),
    ("{1foo}", 1, SUBSTITUTION_DIGIT),
    ("foo//bar", 4, REPEATED),
    ("//foo", 1, REPEATED),
    ("{}", 1, unknown("{}")),
    ("/a/{robot}", 4, unknown("{robot}")),
]


@pytest.mark.parametrize(("name", "index", "problem"), BAD_SERVICE_NAMES)
def test_a_bad_service_name_is_refused_at_its_character(name, index, problem):
    with pytest.raises(InvalidName) as caught:
        expand(name, namespace="/robot1", node="server")
    error = caught.value
    assert (error.name, error.index, error.kind) == (name, index, "service name")
    problem = problem.replace("topic name", "service name", 1)
    assert error.problem == problem
    assert str(error) == f"Invalid service name: {problem}:\n  '{name}'\n   {' ' * index}^"
    assert error.not_executed is True
    assert str(pickle.loads(pickle.dumps(error))) == str(error)


def test_a_topic_is_called_a_topic():
    with pytest.raises(InvalidName, match=r"^Invalid topic name: topic name must not be empty"):
        expand("", kind="topic name")


@pytest.mark.parametrize(
    ("name", "index", "problem"),
    [
        ("", 0, "node name must not be empty"),
        ("1node", 0, "node name must not start with a number"),
        ("a-b", 1, "node name must not contain characters other than alphanumerics or '_'"),
        ("a/b", 1, "node name must not contain characters other than alphanumerics or '_'"),
        ("näme", 1, "node name must not contain characters other than alphanumerics or '_'"),
        ("a\n", 1, "node name must not contain characters other than alphanumerics or '_'"),
        ("n" * 256, 255, "node name must not be longer than 255 characters"),
    ],
)
def test_a_bad_node_name_is_refused_at_its_character(name, index, problem):
    with pytest.raises(InvalidName) as caught:
        check_node_name(name)
    assert (caught.value.index, caught.value.problem) == (index, problem)
    assert caught.value.kind == "node name"


@pytest.mark.parametrize(
    ("name", "index", "problem"),
    [
        ("/a/", 2, "namespace must not end with a '/', unless only a '/'"),
        ("a//b", 3, "namespace must not contain repeated '/'"),
        ("/1a", 1, "namespace must not have a token that starts with a number"),
        ("2", 1, "namespace must not have a token that starts with a number"),
        ("a b", 2, "namespace must not contain characters other than alphanumerics, '_', or '/'"),
        ("~", 1, "namespace must not contain characters other than alphanumerics, '_', or '/'"),
        ("/" + "n" * 245, 245, "namespace must not be longer than 245 characters"),
    ],
)
def test_a_bad_namespace_is_refused_at_its_character(name, index, problem):
    with pytest.raises(InvalidName) as caught:
        check_namespace(name)
    error = caught.value
    assert (error.index, error.problem) == (index, problem)
    assert error.name == (name if name.startswith("/") else f"/{name}")


def test_the_longest_names_that_ros_allows_pass():
    assert check_node_name("n" * 255) == "n" * 255
    assert check_namespace("/" + "n" * 244) == "/" + "n" * 244
    assert expand("x" * 246) == "/" + "x" * 246
    with pytest.raises(InvalidName, match="must not be longer than 247 characters"):
        expand("x" * 247)


@pytest.mark.parametrize(
    ("given_namespace", "namespace"),
    [("", "/"), ("/", "/"), ("robot1", "/robot1"), ("/a/b_2", "/a/b_2"), ("_x", "/_x")],
)
def test_a_namespace_becomes_absolute(given_namespace, namespace):
    assert check_namespace(given_namespace) == namespace


@pytest.mark.parametrize(
    ("name", "in_robot1", "in_root"),
    [
        ("add", "/robot1/add", "/add"),
        ("/add", "/add", "/add"),
        ("a/b", "/robot1/a/b", "/a/b"),
        ("~", "/robot1/server", "/server"),
        ("~/add", "/robot1/server/add", "/server/add"),
        ("{node}", "/robot1/server", "/server"),
        ("{node}/add", "/robot1/server/add", "/server/add"),
        ("{node}_2", "/robot1/server_2", "/server_2"),
        ("/{node}/add", "/server/add", "/server/add"),
        ("{ns}/add", "/robot1/add", "/add"),
        ("/{ns}/add", "/robot1/add", "/add"),
        ("/x/{ns}/{node}", "/x/robot1/server", "/x/server"),
        ("{namespace}/add", "/robot1/add", "/add"),
        ("~/{node}", "/robot1/server/server", "/server/server"),
        ("_hidden", "/robot1/_hidden", "/_hidden"),
        ("A1_/b2", "/robot1/A1_/b2", "/A1_/b2"),
    ],
)
def test_a_name_means_this_to_a_node(name, in_robot1, in_root):
    assert expand(name, namespace="/robot1", node="server") == in_robot1
    assert expand(name, node="server") == in_root


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("~", "'~' stands for a node, and there is none here"),
        ("~/add", "'~' stands for a node, and there is none here"),
        ("a/{node}", "'{node}' stands for a node, and there is none here"),
        ("{ns}", "service name must not end with a '/'"),
    ],
)
def test_substitution_without_a_value_is_refused(name, sentence):
    with pytest.raises(InvalidName) as caught:
        expand(name)
    assert caught.value.problem == sentence


def test_a_node_is_named_with_its_namespace():
    assert fully_qualified("/", "server") == "/server"
    assert fully_qualified("/robot1", "server") == "/robot1/server"


@pytest.mark.parametrize(
    ("name", "hidden"),
    [("/a", False), ("/_a", True), ("/a/_b/c", True), ("/a_b", False), ("_a", True)],
)
def test_a_token_that_begins_with_an_underscore_hides_a_name(name, hidden):
    assert is_hidden(name) is hidden


names = st.one_of(st.text(max_size=20), st.text("ab1_/~{}ns ode", max_size=12))
namespaces = st.sampled_from(["/", "/robot1", "/a/b"])


@given(names, namespaces)
def test_expand_returns_a_valid_name_or_raises_only_invalid_name(name, namespace):
    try:
        expanded = expand(name, namespace=namespace, node="node")
    except InvalidName as error:
        pointed_at = str(error).splitlines()[-1]
        assert pointed_at == f"   {' ' * error.index}^"  # noqa: PT017
        return
    assert expanded.startswith("/")
    assert expand(expanded) == expanded
    assert expand(expanded, namespace="/other", node="other") == expanded


@given(names, names, names)
def test_any_valid_node_and_namespace_expand_to_a_valid_name(name, namespace, node):
    try:
        expanded = expand(name, namespace=namespace, node=node)
    except InvalidName:
        return
    assert expand(expanded) == expanded


@given(names)
def test_checks_raise_only_invalid_name_and_accept_what_they_return(name):
    for check in (check_node_name, check_namespace):
        try:
            accepted = check(name)
        except InvalidName:
            continue
        assert check(accepted) == accepted


@pytest.mark.parametrize(
    ("name", "namespace", "found"),
    [
        ("/ada/robot_task", "/ada", "robot_task"),
        ("/ada/a/b", "/ada", "a/b"),
        ("/robot2/ada/x", "/robot2/ada", "x"),
        ("/adam/x", "/ada", "/adam/x"),
        ("/x", "/", "/x"),
        ("/ada", "/ada", "/ada"),
    ],
)
def test_relative_name_is_what_follows_the_namespace(name, namespace, found):
    assert relative(name, namespace=namespace) == found
    assert expand(found, namespace=namespace) == name
