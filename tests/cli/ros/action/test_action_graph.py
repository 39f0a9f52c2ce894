"""Actions are recognised by their feedback topics."""

import pytest

import srvgen
from taskrpc.cli.ros.action.action_graph import action_type, action_type_name, actions
from taskrpc.core.transport.discovery.entries import RegistryEntry
from taskrpc.core.wire.messages import TopicEndpoint


def endpoint(name, type_name, node):
    return TopicEndpoint(name, type_name, "", node, 10, True, False)


def test_publishers_of_feedback_are_servers_and_subscriptions_are_clients():
    one, two = "p/action/One_FeedbackMessage", "p/action/Two_FeedbackMessage"
    entry = RegistryEntry(
        pid=1,
        script="",
        folder="",
        since=0.0,
        publishers=[
            endpoint("/z/_action/feedback", one, "/a"),
            endpoint("/z/_action/status", "action_msgs/msg/GoalStatusArray", "/a"),
            endpoint("/feedback", one, "/a"),
        ],
        subscriptions=[
            endpoint("/z/_action/feedback", two, "/b"),
            endpoint("/c/_action/feedback", one, "/b"),
        ],
    )
    found = actions([entry])
    assert list(found) == ["/c", "/z"]
    assert (found["/z"].servers, found["/z"].clients) == (
        {"/a": "p/action/One"},
        {"/b": "p/action/Two"},
    )
    assert found["/z"].types == ["p/action/One", "p/action/Two"]


def test_types_may_be_written_without_the_folder():
    assert action_type_name("p/Name") == "p/action/Name"
    assert (
        action_type_name("example_interfaces/action/Fibonacci")
        == action_type("example_interfaces/Fibonacci")._TYPE
    )


@pytest.mark.parametrize("text", ["p/action/Name", "std_srvs/srv/Trigger", "nonsense"])
def test_other_types_are_invalid(text):
    with pytest.raises(srvgen.DefinitionError, match="The passed action type is invalid"):
        action_type(text)
