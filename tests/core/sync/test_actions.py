"""Blocking programs send goals, read feedback with `for`, and run callbacks in threads."""

import threading
import time

import pytest

import srvgen
import taskrpc
import taskrpc.sync

pytestmark = pytest.mark.real_time

Fibonacci = srvgen.load("example_interfaces/action/Fibonacci")


def execute(goal):
    for number in range(goal.request.order):
        goal.publish_feedback(Fibonacci.Feedback(sequence=[number]))
    while goal.request.order == 0 and not goal.is_cancel_requested:
        time.sleep(0.002)
    result = Fibonacci.Result(sequence=[threading.current_thread() is not threading.main_thread()])
    return goal.canceled(result) if goal.is_cancel_requested else result


@pytest.fixture
def client():
    with (
        taskrpc.sync.Node("server", token="s") as server,
        taskrpc.sync.Node("client", token="c") as node,
    ):
        server.create_action_server(Fibonacci, "fibonacci", execute, goal=lambda g: g.order >= 0)
        client = node.create_action_client(Fibonacci, "fibonacci")
        assert client.wait_for_server(60)
        assert client.server_is_ready()
        yield client
        client.destroy()


def test_a_blocking_program_reads_the_feedback_and_the_result(client):
    handle = client.send_goal(Fibonacci.Goal(order=3), timeout=60)
    assert [each.sequence[0] for each in handle.feedback] == [0, 1, 2]
    assert list(handle.result(60).sequence) == [1]
    assert handle.state is taskrpc.GoalState.SUCCEEDED
    assert handle.feedback.dropped == 0
    assert len(handle.goal_id) == 32


def test_a_blocking_program_cancels_a_goal(client):
    handle = client.send_goal(Fibonacci.Goal(order=0))
    with pytest.raises(taskrpc.DeadlineExceeded):
        handle.result(timeout=0.01)
    assert handle.cancel()
    with pytest.raises(taskrpc.GoalCanceled):
        handle.result(60)


def test_a_rejected_goal_raises_in_the_calling_thread(client):
    with pytest.raises(taskrpc.GoalRejected):
        client.send_goal(Fibonacci.Goal(order=-1))
