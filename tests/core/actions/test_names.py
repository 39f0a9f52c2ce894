"""The names of an action's services and topics are ROS's."""

import pytest

from taskrpc.actions.names import action_of_feedback, names_of

TYPE = "example_interfaces/action/Fibonacci"


def test_an_action_has_the_names_of_ros():
    names = names_of("/lab/fibonacci")
    assert names.services == (
        "/lab/fibonacci/_action/send_goal",
        "/lab/fibonacci/_action/cancel_goal",
        "/lab/fibonacci/_action/get_result",
    )
    assert names.topics == ("/lab/fibonacci/_action/feedback", "/lab/fibonacci/_action/status")
    assert names.action == "/lab/fibonacci"


@pytest.mark.parametrize("name", ["/fibonacci", "/a/b", "/a/_action/b"])
def test_an_action_is_recognised_by_the_topic_of_its_feedback(name):
    found = action_of_feedback(names_of(name).feedback, f"{TYPE}_FeedbackMessage")
    assert found == (name, TYPE)


@pytest.mark.parametrize(
    ("topic", "type_name"),
    [
        ("/fibonacci/_action/status", "action_msgs/msg/GoalStatusArray"),
        ("/fibonacci/_action/feedback", "std_msgs/msg/String"),
        ("/fibonacci/feedback", f"{TYPE}_FeedbackMessage"),
        ("/_action/feedback", f"{TYPE}_FeedbackMessage"),
        ("/fibonacci/_action/feedback/more", f"{TYPE}_FeedbackMessage"),
    ],
)
def test_other_topics_belong_to_no_action(topic, type_name):
    assert action_of_feedback(topic, type_name) is None
