"""Action servers accept, execute, cancel and end goals, and keep their results for a while."""

import time

import pytest

from taskrpc.errors import HandlerFailed, NameInUse
from taskrpc.ros.packages.rclpy.action import ActionServer, CancelResponse, GoalResponse
from taskrpc.ros.packages.rclpy.action import server as server_module
from taskrpc.ros.packages.rclpy.callback_groups import ReentrantCallbackGroup
from taskrpc.ros.packages.rclpy.clock import ClockType
from taskrpc.ros.packages.rclpy.executors import MultiThreadedExecutor
from taskrpc.ros.packages.rclpy.qos import qos_profile_system_default
from taskrpc.ros.packages.rclpy.service_introspection import ServiceIntrospectionState
from taskrpc.ros.packages.rclpy.time import Time
from tests.ros.packages.rclpy.action.actions import (
    UUID,
    Fibonacci,
    GoalStatus,
    action,
    ended,
    order,
    result,
    succeed,
)

pytestmark = pytest.mark.real_time


def accept_all(_):
    return CancelResponse.ACCEPT


def later(_):
    """Accept a goal without executing it."""


class Deferred:
    """Keeps the handles of accepted goals."""

    def __init__(self):
        self.handles = []

    def __call__(self, handle):
        self.handles.append(handle)


def aborting(goal):
    goal.abort()
    return result(1)


def raising(goal):
    raise ValueError("boom")


def undecided(goal):
    return result(2)


async def coroutine(goal):
    goal.succeed()
    return result(3)


@pytest.mark.parametrize(
    ("execute", "outcome"),
    [
        (succeed, (GoalStatus.STATUS_SUCCEEDED, [5])),
        (coroutine, (GoalStatus.STATUS_SUCCEEDED, [3])),
        (aborting, (GoalStatus.STATUS_ABORTED, [1])),
        (undecided, (GoalStatus.STATUS_ABORTED, [2])),
        (raising, (GoalStatus.STATUS_ABORTED, [])),
    ],
)
def test_the_callback_decides_how_a_goal_ends(execute, outcome):
    with action(execute) as pair:
        assert pair.finish(order(5)) == outcome


def test_an_exception_and_a_missing_state_are_logged_as_in_ros(capfd):
    with action(raising) as pair:
        pair.finish(order(5), goal_uuid=UUID(uuid=[255, *[7] * 15]))
    error = capfd.readouterr().err
    assert "[served.action_server]: Error raised in execute callback: boom\nTraceback" in error
    numbers = " ".join(["  7"] * 15)
    assert f"Goal state not set, assuming aborted. Goal ID: [255 {numbers}]\n" in error


@pytest.mark.parametrize("answer", [GoalResponse.REJECT, "yes", None])
def test_a_goal_that_is_not_accepted_is_not_executed(answer, capfd):
    with action(pytest.fail, goal_callback=lambda goal: answer) as pair:
        handle = pair.send(order(5))
        assert (handle.accepted, handle.stamp.sec) == (False, 0)
    warned = "did not return a GoalResponse type. Rejecting goal." in capfd.readouterr().err
    assert warned == (answer is not GoalResponse.REJECT)


def test_callbacks_may_be_coroutines():
    async def accept(goal):
        return GoalResponse.ACCEPT

    async def accepted(handle):
        handle.execute()

    with action(goal_callback=accept, handle_accepted_callback=accepted) as pair:
        assert pair.finish(order(5)) == (GoalStatus.STATUS_SUCCEEDED, [5])


def test_an_exception_in_the_goal_callback_ends_the_spin_and_reaches_the_client():
    def accept(goal):
        raise ValueError("no")

    with action(goal_callback=accept) as pair:
        future = pair.client.send_goal_async(order(5))
        with pytest.raises(ValueError, match="no"):
            pair.world.spin_until(lambda: False)
        pair.world.spin_until(future.done)
        assert isinstance(future.exception(), HandlerFailed)


def test_an_id_is_accepted_once():
    with action() as pair:
        same = UUID(uuid=[7] * 16)
        answers = [pair.send(order(5), goal_uuid=same).accepted for _ in range(2)]
        assert answers == [True, False]


def test_a_deferred_goal_that_is_cancelled_is_still_given_to_its_callback():
    def execute(goal):
        assert goal.is_cancel_requested
        goal.canceled()
        return result(9)

    deferred = Deferred()
    with action(execute, handle_accepted_callback=deferred, cancel_callback=accept_all) as pair:
        handle = pair.send(order(1))
        [served] = deferred.handles
        assert (served.status, served.is_active) == (GoalStatus.STATUS_ACCEPTED, True)
        assert (served.goal_id, served.request.order) == (handle.goal_id, 1)
        assert pair.cancel(handle) == 1
        assert served.status == GoalStatus.STATUS_CANCELING
        served.execute()
        response = pair.world.answer(handle.get_result_async())
        assert ended(response) == (GoalStatus.STATUS_CANCELED, [9])
        assert (served.status, served.is_active) == (GoalStatus.STATUS_CANCELED, False)


def test_a_server_cancels_no_goal_unless_its_callback_accepts():
    with action(handle_accepted_callback=later) as pair:
        assert pair.cancel(pair.send(order(1))) == 0
        pair.server.register_cancel_callback(accept_all)
        assert pair.cancel(pair.send(order(1))) == 1
        pair.server.register_cancel_callback(None)
        assert pair.cancel(pair.send(order(1))) == 0


def test_a_result_is_sent_after_the_response_to_the_cancellation():
    deferred = Deferred()

    def decide(goal):
        if goal == deferred.handles[1]:  # the first goal ends before the response is sent
            deferred.handles[0].canceled(result(7))
        return CancelResponse.ACCEPT

    with action(handle_accepted_callback=deferred, cancel_callback=decide) as pair:
        handle = pair.send(order(1))
        pair.send(order(2))
        arrived = []
        answers = (handle.get_result_async(), "result"), (all_cancelled(pair.client), "cancel")
        for future, name in answers:
            future.add_done_callback(lambda _, name=name: arrived.append(name))
        pair.world.spin_until(lambda: len(arrived) == 2)
        assert arrived == ["cancel", "result"]
        assert ended(answers[0][0].result()) == (GoalStatus.STATUS_CANCELED, [7])


def all_cancelled(client):
    """Cancel all goals; returns the future of the response."""
    return client._cancel.call_async(client._messages.cancel_goal.Request())


def test_a_cancel_callback_that_returns_something_else_is_explained(capsys):
    with action(handle_accepted_callback=later, cancel_callback=lambda goal: True) as pair:
        assert pair.cancel(pair.send(order(1))) == 0
    said = "the cancel callback of /fibonacci returned a value of the type bool; return CancelResp"
    assert said in capsys.readouterr().err


def test_a_request_to_cancel_may_mean_many_goals():
    deferred = Deferred()
    with action(handle_accepted_callback=deferred, cancel_callback=accept_all) as pair:
        first, second, third = (pair.send(order(number)) for number in range(3))
        request = Fibonacci.Impl.CancelGoalService.Request()
        request.goal_info.stamp = second.stamp
        found = pair.world.answer(pair.client._cancel.call_async(request))
        assert [one.goal_id for one in found.goals_canceling] == [first.goal_id, second.goal_id]
        request.goal_info.stamp.sec = request.goal_info.stamp.nanosec = 0
        found = pair.world.answer(pair.client._cancel.call_async(request))
        assert [one.goal_id for one in found.goals_canceling] == [third.goal_id]
        assert all(one.is_cancel_requested for one in deferred.handles)


def test_a_callback_that_returns_no_result_ends_the_spin(capsys):
    def execute(goal):
        goal.succeed()

    with action(execute) as pair:
        future = pair.client.send_goal_async(order(1))
        problem = r"the execute callback of /fibonacci returned nothing; is `return result` .*miss"
        with pytest.raises(TypeError, match=problem):
            pair.world.spin_until(lambda: False)
        assert pair.world.answer(future).accepted
        assert "ROS 2 would end the spin of the server" in capsys.readouterr().err


def test_a_class_in_place_of_a_result_is_explained():
    def execute(goal):
        goal.succeed()
        return Fibonacci.Result

    with action(execute) as pair:
        pair.client.send_goal_async(order(1))
        problem = r"returned the class Fibonacci_Result \(write `Fibonacci_Result\(\)`\)"
        with pytest.raises(TypeError, match=problem):
            pair.world.spin_until(lambda: False)


def test_another_message_with_the_fields_of_the_result_will_do():
    def execute(goal):
        goal.succeed()
        return Fibonacci.Feedback(sequence=[1, 2])

    with action(execute) as pair:
        assert pair.finish(order(1)) == (GoalStatus.STATUS_SUCCEEDED, [1, 2])


def test_a_result_expires_in_simulated_time():
    with action(result_timeout=1000) as pair:
        clock = pair.served.get_clock()
        clock._set_ros_time_is_active(True)
        clock.set_ros_time_override(Time(seconds=100, clock_type=ClockType.ROS_TIME))
        handle = pair.send(order(5))
        for seconds, status in ((100, 4), (1099, 4), (1101, 0)):
            clock.set_ros_time_override(Time(seconds=seconds, clock_type=ClockType.ROS_TIME))
            pair.world.spin_until(lambda n=status: n or not len(pair.server._ledger))
            response = pair.world.answer(handle.get_result_async())
            assert response.status == status


def test_a_result_expires(capfd):
    with action(result_timeout=0.2) as pair:
        handle = pair.send(order(1))
        assert len(pair.server._goal_handles) == 1
        pair.world.spin_until(lambda: not pair.server._goal_handles)
        response = pair.world.answer(handle.get_result_async())
        assert ended(response) == (GoalStatus.STATUS_UNKNOWN, [])
    assert "Sending result response for unknown or expired goal ID: [" in capfd.readouterr().err


def test_the_expiry_of_a_result_ends_the_sleep_of_the_executor():
    with action(result_timeout=0.1) as pair:
        pair.finish(order(1))
        while pair.server._goal_handles:
            pair.world.executor.spin_once(60)  # reached only by a failing test


def test_a_late_client_learns_the_states_of_all_goals():
    with action(handle_accepted_callback=later) as pair:
        goals = [pair.send(order(number)).goal_id for number in range(2)]
        messages = []
        pair.calling.create_subscription(
            Fibonacci.Impl.GoalStatusMessage,
            "fibonacci/_action/status",
            messages.append,
            pair.client._status.qos_profile,
        )
        pair.world.spin_until(lambda: messages)
        states = [(one.goal_info.goal_id, one.status) for one in messages[-1].status_list]
        assert states == [(goal, GoalStatus.STATUS_ACCEPTED) for goal in goals]


def test_the_status_of_many_goals_is_published_less_often(monkeypatch):
    monkeypatch.setattr(server_module, "_MANY_GOALS", 1)
    monkeypatch.setattr(server_module, "_STATUS_EVERY", 600)
    with action(handle_accepted_callback=later) as pair:
        published = []
        publish = lambda goals: published.append(len(goals))  # noqa: E731
        monkeypatch.setattr(pair.server._parts, "publish_status", publish)
        for number in range(4):
            pair.send(order(number))
        assert published == [1]
        monkeypatch.setattr(server_module, "_STATUS_EVERY", 0)
        pair.server._status_due = 0.0
        pair.world.spin_until(lambda: published == [1, 4])
        assert pair.server.nanoseconds_until_due() is None


def test_goals_run_in_parallel_in_a_pool():
    running, most = [], []

    def execute(goal):
        running.append(goal)
        end = time.monotonic() + 60
        while len(running) < 3 and time.monotonic() < end:
            time.sleep(0.001)
        most.append(len(running))
        goal.succeed()
        return result(goal.request.order)

    with action(execute, callback_group=ReentrantCallbackGroup()) as pair:
        pool = MultiThreadedExecutor(4, context=pair.world.context)
        for node in (pair.served, pair.calling):
            pool.add_node(node)
        handles = []
        for future in [pair.client.send_goal_async(order(number)) for number in range(3)]:
            pool.spin_until_future_complete(future, 60)
            handles.append(future.result())
        for handle in handles:
            future = handle.get_result_async()
            pool.spin_until_future_complete(future, 60)
            assert future.result().status == GoalStatus.STATUS_SUCCEEDED
        pool.shutdown()
    assert most == [3, 3, 3]


def test_introspection_publishes_the_events_of_the_services():
    with action() as pair:
        events = []
        kind = Fibonacci.Impl.SendGoalService.Event
        topic = "fibonacci/_action/send_goal/_service_event"
        pair.calling.create_subscription(kind, topic, events.append, 10)
        for side in (pair.server, pair.client):
            side.configure_introspection(
                pair.served.get_clock(),
                qos_profile_system_default,
                ServiceIntrospectionState.CONTENTS,
            )
        pair.send(order(5))
        pair.world.spin_until(lambda: len(events) == 4)
        assert sorted(one.info.event_type for one in events) == [0, 1, 2, 3]
        assert {one.request[0].goal.order for one in events if len(one.request)} == {5}


def test_numbers_of_entities_are_those_of_ros():
    with action() as pair:
        numbers = pair.server.get_num_entities(), pair.client.get_num_entities()
        assert [(one.num_services, one.num_timers) for one in numbers] == [(3, 1), (0, 0)]
        assert [(one.num_clients, one.num_subscriptions) for one in numbers] == [(0, 0), (3, 2)]
        parts = [one.service_name for one in (*pair.served.services, *pair.calling.clients)]
        assert not [name for name in parts if "_action" in name]


def test_the_name_of_an_action_in_another_program_is_refused(monkeypatch):
    def offer(*args, **options):
        raise NameInUse("/fibonacci/_action/send_goal is offered, or join it with join=True")

    with action() as pair:
        monkeypatch.setattr(type(pair.served.handle.bridge), "offer", offer)
        with pytest.raises(NameInUse, match=r"is offered$"):
            ActionServer(pair.served, Fibonacci, "again", succeed)
