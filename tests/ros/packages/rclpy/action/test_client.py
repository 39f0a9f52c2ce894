"""Action clients send goals, and receive responses, feedback, statuses and results."""

import threading

import pytest

import taskrpc
import taskrpc.sync
from taskrpc.errors import WouldDeadlock
from taskrpc.ros.packages.rclpy import action as action_module
from taskrpc.ros.packages.rclpy.action import ActionClient, CancelResponse, GoalResponse
from taskrpc.ros.packages.rclpy.action.client import ClientGoalHandle
from taskrpc.ros.packages.rclpy.exceptions import InvalidHandle, InvalidTopicNameException
from tests.ros.packages.rclpy.action.actions import (
    UUID,
    Fibonacci,
    GoalStatus,
    action,
    ended,
    order,
    result,
)
from tests.ros.packages.rclpy.living import living, until

pytestmark = pytest.mark.real_time


def count(goal):
    for number in range(goal.request.order):
        goal.publish_feedback(Fibonacci.Feedback(sequence=[number]))
    goal.succeed()
    return result(goal.request.order)


def test_a_goal_gets_its_feedback_and_its_result():
    with action(count) as pair:
        messages = []
        handle = pair.send(order(3), feedback_callback=messages.append)
        assert handle.accepted
        pair.world.spin_until(lambda: len(messages) == 3)
        assert [list(one.feedback.sequence) for one in messages] == [[0], [1], [2]]
        assert {bytes(one.goal_id.uuid) for one in messages} == {bytes(handle.goal_id.uuid)}
        response = pair.world.answer(handle.get_result_async())
        assert ended(response) == (GoalStatus.STATUS_SUCCEEDED, [3])
        pair.world.spin_until(lambda: handle.status == GoalStatus.STATUS_SUCCEEDED)


def test_a_server_of_the_native_api_is_used_as_one_of_ros():
    def accept(goal):
        if goal.order == 1:
            raise taskrpc.HandlerError("OUT_OF_RANGE", "not one")
        return goal.order > 0

    def execute(goal):
        goal.publish_feedback(Fibonacci.Feedback(sequence=[goal.request.order]))
        if goal.request.order == 2:
            raise taskrpc.HandlerError("NOT_FOUND", "no such number")
        return result(goal.request.order)

    with taskrpc.sync.Node("native") as node, living() as world:
        node.create_action_server(Fibonacci, "fibonacci", execute, goal=accept)
        client = ActionClient(world.node("calling"), Fibonacci, "fibonacci")
        assert client.wait_for_server(10)

        def send(number):
            return world.answer(client.send_goal_async(order(number)))

        assert [send(number).accepted for number in range(4)] == [False, False, True, True]
        for number, expected in (
            (2, (GoalStatus.STATUS_ABORTED, [])),
            (3, (GoalStatus.STATUS_SUCCEEDED, [3])),
        ):
            assert ended(world.answer(send(number).get_result_async())) == expected


def test_a_client_of_the_native_api_uses_a_server_of_ros():
    with action(count) as pair, taskrpc.sync.Node("native") as node:
        client = node.create_action_client(Fibonacci, "fibonacci")
        sent = []

        def run():
            handle = client.send_goal(order(3))
            sent.append([list(each.sequence) for each in handle.feedback])
            sent.append(list(handle.result(10).sequence))

        thread = threading.Thread(target=run)
        thread.start()
        pair.world.spin_until(lambda: len(sent) == 2)
        thread.join(10)
        assert sent == [[[0], [1], [2]], [3]]


def test_feedback_that_arrives_before_the_response_comes_after_it():
    """The callback of the response stores the handle that the callback of feedback uses."""
    events = []

    def accept(goal):
        message = Fibonacci.Impl.FeedbackMessage(goal_id=UUID(uuid=[7] * 16))
        pair.server._parts._feedback.publish(message)
        until(pair.client._feedback.has_work)
        return GoalResponse.ACCEPT

    with action(handle_accepted_callback=lambda _: None) as pair:
        pair.server.register_goal_callback(accept)
        future = pair.client.send_goal_async(
            order(1), lambda _: events.append("feedback"), UUID(uuid=[7] * 16)
        )
        future.add_done_callback(lambda _: events.append("response"))
        pair.world.spin_until(lambda: len(events) == 2)
    assert events == ["response", "feedback"]


def test_feedback_callbacks_may_be_coroutines():
    with action(count) as pair:
        messages = []

        async def take(message):
            messages.append(message)

        pair.send(order(2), feedback_callback=take)
        pair.world.spin_until(lambda: len(messages) == 2)


def test_a_goal_keeps_the_id_that_the_program_gives():
    with action() as pair:
        handle = pair.send(order(1), goal_uuid=UUID(uuid=[7] * 16))
        assert list(handle.goal_id.uuid) == [7] * 16
        pair.world.spin_until(lambda: handle.status == GoalStatus.STATUS_SUCCEEDED)
        numbers = " ".join(["7"] * 16)
        assert repr(handle) == f"ClientGoalHandle <id=[{numbers}], accepted=True, status=4>"
        assert handle == handle
        assert handle != pair.send(order(1))
        assert handle.stamp.sec > 0


def test_goals_of_another_type_and_invalid_names_are_refused():
    with action() as pair:
        for send in (pair.client.send_goal, pair.client.send_goal_async):
            with pytest.raises(TypeError, match=r"Expected goal type .*Fibonacci_Goal.* but recei"):
                send("five")
        with pytest.raises(TypeError, match="Expected type ClientGoalHandle but received"):
            pair.client._get_result_async("a handle")
        with pytest.raises(InvalidTopicNameException):
            ActionClient(pair.calling, Fibonacci, "bad name")


def test_a_client_without_a_server_finds_none():
    with living() as world:
        client = ActionClient(world.node(), Fibonacci, "nowhere")
        assert (client.server_is_ready(), client.wait_for_server(timeout_sec=0.05)) == (False,) * 2
        client.destroy()
        with pytest.raises(InvalidHandle):
            client.server_is_ready()
        with pytest.raises(InvalidHandle):
            client.send_goal_async(order(1))


def test_blocking_calls_return_the_response_while_another_thread_spins():
    with action() as pair:
        spinning = threading.Thread(target=pair.world.executor.spin)
        spinning.start()
        assert ended(pair.client.send_goal(order(5))) == (GoalStatus.STATUS_SUCCEEDED, [5])
        future = pair.client.send_goal_async(order(6))
        done = threading.Event()
        future.add_done_callback(lambda _: done.set())
        assert done.wait(60)
        handle = future.result()
        assert ended(handle.get_result()) == (GoalStatus.STATUS_SUCCEEDED, [6])
        assert handle.cancel_goal().return_code == 3  # it has ended
        pair.world.executor.shutdown()
        spinning.join()


def test_a_blocking_call_in_a_callback_is_refused():
    with action() as pair:
        errors = []

        def tick():
            try:
                pair.client.send_goal(order(1))
            except WouldDeadlock as error:
                errors.append(str(error))

        pair.calling.create_timer(0.001, tick)
        pair.world.spin_until(lambda: errors)
        assert "/fibonacci/_action/send_goal" in errors[0]


def test_the_end_of_the_server_ends_the_wait_for_a_result(capsys):
    with action(handle_accepted_callback=lambda _: None) as pair:
        handle = pair.send(order(1))
        future = handle.get_result_async()
        pair.world.spin_until(lambda: pair.server._results._waiting)
        pair.server.destroy()
        pair.world.spin_until(future.done)
        assert "the server of /fibonacci was destroyed" in str(future.exception())
        assert "ROS 2 would never complete this future" in capsys.readouterr().err


def test_a_handle_that_the_program_drops_is_forgotten_when_its_goal_ends():
    with action(handle_accepted_callback=lambda _: None) as pair:
        pair.send(order(1))
        assert len(pair.client._goal_handles) == 1
        pair.server._goal_handles.popitem()[1].execute()
        pair.world.spin_until(lambda: not pair.client._goal_handles)


def test_the_end_of_the_node_ends_its_actions():
    with action() as pair:
        pair.served.destroy_node()
        pair.world.spin_until(lambda: not pair.client.server_is_ready())
        pair.calling.destroy_node()
        with pytest.raises(InvalidHandle):
            pair.client.server_is_ready()


def test_action_modules_have_the_names_that_programs_import():
    assert action_module.client.GoalStatus is action_module.server.GoalStatus is GoalStatus
    assert ClientGoalHandle[int, int, int]
    assert ActionClient[int, int, int]


def test_the_name_of_an_action_is_remapped_as_in_ros():
    arguments = ["--ros-args", "-r", "turtle1/rotate:=turtle2/rotate"]
    with living() as world:
        node = world.node("remapped", cli_args=arguments)
        server = action_module.ActionServer(node, Fibonacci, "turtle1/rotate", count)
        client = ActionClient(node, Fibonacci, "turtle1/rotate")
        for names in (
            action_module.get_action_client_names_and_types_by_node,
            action_module.get_action_server_names_and_types_by_node,
        ):
            until(lambda names=names: names(node, "remapped", "/"))
            assert [name for name, _ in names(node, "remapped", "/")] == ["/turtle2/rotate"]
        client.destroy()
        server.destroy()


def test_the_callback_for_a_cancellation_runs_before_that_for_the_result():
    kept = []

    def execute(goal):
        goal.canceled()
        return result(1)

    settings = {"cancel_callback": lambda _: CancelResponse.ACCEPT}
    with action(execute, handle_accepted_callback=kept.append, **settings) as pair:
        handle = pair.send(order(1))
        pair.world.executor.remove_node(pair.calling)
        arrived, client = [], pair.client
        for name, future in (
            ("result", handle.get_result_async()),
            ("cancel", handle.cancel_goal_async()),
        ):
            future.add_done_callback(lambda _, name=name: arrived.append(name))
        pair.world.spin_until(lambda: kept[0].is_cancel_requested)
        kept[0].execute()
        # Both responses wait for the executor.
        pair.world.spin_until(lambda: client._cancel.has_work() and client._result.has_work())
        pair.world.executor.add_node(pair.calling)
        pair.world.spin_until(lambda: len(arrived) == 2)
        assert arrived == ["cancel", "result"]
