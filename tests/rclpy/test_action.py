"""Names of actions, which taskrpc does not have yet."""

import pytest

import srvgen
from taskrpc.rclpy import action
from taskrpc.rclpy.action import ActionClient, ActionServer


def test_a_program_with_actions_is_warned_once_and_runs_until_it_uses_one(capsys, fake, context):
    for _ in range(2):
        client = ActionClient(fake, None, "turn")
        server = ActionServer(fake, None, "turn", print, goal_callback=print)
    error = capsys.readouterr().err
    assert [line.split(" does nothing here: ")[0] for line in error.splitlines()] == [
        "[taskrpc] ActionClient('turn')",
        "[taskrpc] ActionServer('turn')",
    ]
    server.register_execute_callback(print)
    assert (client.server_is_ready(), client.wait_for_server(timeout_sec=0.01)) == (False, False)
    for use in (client.wait_for_server, lambda: client.send_goal_async(None)):
        with pytest.raises(NotImplementedError, match="no actions yet; use a service"):
            use()
    client.destroy()
    server.destroy()


def test_action_modules_have_the_names_that_programs_import():
    status = srvgen.load("action_msgs/msg/GoalStatus")
    assert action.client.GoalStatus is action.server.GoalStatus is status
