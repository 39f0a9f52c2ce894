"""Calls and messages of programs are events; those that taskrpc makes by itself are not."""

import pytest

from taskrpc.simulation.run.observing import is_hidden
from tests.simulation.small_programs import CLIENT, ROBOT, ROS_CLIENT, ROS_ROBOT

FAILING = """
    @scenario.finally_
    def fails(world):
        assert False
    """


@pytest.mark.parametrize(
    "name", ["/rosout", "/parameter_events", "/_hidden", "/robot/get_parameters"]
)
def test_names_that_programs_do_not_use_are_hidden(name):
    assert is_hidden(name)


@pytest.mark.parametrize("name", ["/pick", "/robot/pick", "/chatter"])
def test_names_of_programs_are_seen(name):
    assert not is_hidden(name)


@pytest.mark.real_time
@pytest.mark.parametrize("programs", [(ROBOT, CLIENT), (ROS_ROBOT, ROS_CLIENT)])
def test_each_call_is_begun_handled_and_answered(simulated, programs):
    loaded = simulated(FAILING, duration=2, robot=programs[0], client=programs[1])
    events = [each for each in loaded.explain().events if each.text == "/pick"]
    kinds = [(each.program, each.kind) for each in events]
    assert kinds == [("client", "call"), ("robot", "begin"), ("client", "answer")] * 3
    assert events[0].where.startswith("client.py:")


@pytest.mark.real_time
def test_lost_response_is_a_fault_and_an_error_of_the_caller(simulated):
    loaded = simulated(
        "scenario.faults(lose_responses=1.0)",
        robot=ROBOT,
        client=CLIENT.replace('print("failed", number, type(error).__name__)', "raise"),
    )
    told = [
        (each.program, each.kind, each.text)
        for each in loaded.explain().events
        if each.kind in ("begin", "fault", "error", "raise")
    ]
    assert told == [
        ("robot", "begin", "/pick"),
        ("robot", "fault", "lose response 1 of /pick"),
        ("client", "error", "/pick DEADLINE_EXCEEDED"),
        ("client", "raise", "DeadlineExceeded"),
    ]


@pytest.mark.real_time
def test_message_that_no_subscription_gets_is_told_as_such(simulated):
    loaded = simulated(
        FAILING,
        a="""
        import time
        import rclpy
        from std_msgs.msg import String
        rclpy.init()
        node = rclpy.create_node("a")
        publisher = node.create_publisher(String, "chatter", 10)
        publisher.publish(String(data="word"))
        node.create_subscription(String, "chatter", print, 10)
        time.sleep(1)
        publisher.publish(String(data="word"))
        """,
    )
    texts = [each.text for each in loaded.explain().events if each.kind == "message"]
    assert texts == ["/chatter; no subscription gets it now", "/chatter"]


def test_messages_are_events_of_their_publisher(simulated):
    loaded = simulated(
        FAILING,
        a="""
        import rclpy
        from std_msgs.msg import String
        rclpy.init()
        publisher = rclpy.create_node("a").create_publisher(String, "chatter", 10)
        publisher.publish(String(data="word"))
        """,
    )
    events = loaded.explain().events
    [message] = [each for each in events if each.kind == "message"]
    assert (message.program, message.text) == ("a", "/chatter; no subscription gets it now")
    assert message.where == "a.py:6"
