"""The services and publishers of an action server begin and end together."""

import pytest

import srvgen
from taskrpc.actions.messages import ActionMessages
from taskrpc.ros.packages.rclpy._impl.actions import server_parts
from taskrpc.ros.packages.rclpy._impl.actions.server_parts import Profiles, ServerParts
from taskrpc.ros.packages.rclpy.qos import (
    qos_profile_action_status_default,
    qos_profile_services_default,
)
from tests.ros.packages.rclpy.living import living

pytestmark = pytest.mark.real_time

MESSAGES = ActionMessages(srvgen.load("example_interfaces/action/Fibonacci"))
PROFILES = Profiles(*[qos_profile_services_default] * 4, qos_profile_action_status_default)


def test_each_request_is_taken_once():
    with living() as world:
        node = world.node()
        parts = ServerParts(node, MESSAGES, "turn", node.default_callback_group, PROFILES)
        client = node.create_client(MESSAGES.get_result, "turn/_action/get_result")
        future = client.call_async(MESSAGES.get_result.Request())
        world.spin_until(parts.has_work)
        [taken] = parts.take()
        assert taken.service is parts.results
        assert not parts.has_work()
        assert not list(parts.take())
        parts.results.send_response(MESSAGES.get_result.Response(status=4), taken.header)
        assert world.answer(future).status == 4
        parts.destroy()


def test_messages_to_the_program_itself_have_arrived_after_settle(monkeypatch):
    waits = []
    monkeypatch.setattr(server_parts, "settle", lambda: waits.append("settled"))
    with living() as world:
        node = world.node()
        parts = ServerParts(node, MESSAGES, "turn", node.default_callback_group, PROFILES)
        parts.settle()
        assert not waits
        client = node.create_client(MESSAGES.send_goal, "turn/_action/send_goal")
        parts.settle()
        node.destroy_client(client)
        parts.settle()
        assert waits == ["settled"]
        parts.destroy()


def test_an_error_withdraws_the_parts_that_were_made():
    with living() as world:
        node = world.node()
        profiles = PROFILES._replace(status=None)
        with pytest.raises(AttributeError):
            ServerParts(node, MESSAGES, "turn", node.default_callback_group, profiles)
        assert not [name for name, _ in node.get_service_names_and_types() if "_action" in name]
