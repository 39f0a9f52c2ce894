"""spin, spin_once and spin_until_future_complete with nodes that are real."""

from __future__ import annotations

import threading
import time

import pytest

import srvgen
from taskrpc.errors import WouldDeadlock
from taskrpc.ros.packages import rclpy
from taskrpc.ros.packages.rclpy import timer as timer_module
from taskrpc.ros.packages.rclpy.callback_groups import ReentrantCallbackGroup
from taskrpc.ros.packages.rclpy.exceptions import NotInitializedException, ROSInterruptException
from taskrpc.ros.packages.rclpy.executors import (
    ExternalShutdownException,
    MultiThreadedExecutor,
    SingleThreadedExecutor,
)
from taskrpc.ros.packages.rclpy.task import Future
from taskrpc.ros.packages.rclpy.waitable import Waitable

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")
Empty = srvgen.load("std_msgs/msg/Empty")

pytestmark = pytest.mark.real_time


@pytest.fixture
def node():
    rclpy.init(args=[])
    yield rclpy.create_node("spinner")
    rclpy.try_shutdown()


@pytest.fixture
def spinning(node):
    """The node, while another thread spins it."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    thread = threading.Thread(target=executor.spin)
    thread.start()
    yield node
    executor.shutdown()
    thread.join(5)
    assert not thread.is_alive()


def test_a_node_needs_init():
    with pytest.raises(NotInitializedException, match=r"rclpy.init\(\) has not been called"):
        rclpy.create_node("early", context=rclpy.Context())


def test_a_timer_runs_while_a_thread_spins(node):
    calls = []
    node.create_timer(0.01, lambda: calls.append(1))
    assert calls == []
    rclpy.spin_once(node, timeout_sec=5)
    assert calls == [1]


def test_spinning_once_takes_the_node_and_gives_it_back(node):
    rclpy.spin_once(node, timeout_sec=0)
    assert node.executor is rclpy.get_global_executor()
    assert rclpy.get_global_executor().get_nodes() == []


def test_a_call_is_answered_while_its_own_node_spins(node):
    def add(request, response):
        response.sum = request.a + request.b
        return response

    node.create_service(AddTwoInts, "add", add)
    client = node.create_client(AddTwoInts, "add")
    future = client.call_async(AddTwoInts.Request(a=1, b=2))
    rclpy.spin_until_future_complete(node, future, timeout_sec=5)
    assert future.result() == AddTwoInts.Response(sum=3)


def test_done_callbacks_of_a_call_run_in_the_next_round(node):
    seen = []
    node.create_service(AddTwoInts, "add", lambda request, response: response)
    client = node.create_client(AddTwoInts, "add")
    future = client.call_async(AddTwoInts.Request())
    future.add_done_callback(seen.append)
    rclpy.spin_until_future_complete(node, future, timeout_sec=5)
    assert future.done()
    assert seen == []
    rclpy.spin_once(node, timeout_sec=0)
    assert seen == [future]


def test_a_service_awaits_another_one_in_a_reentrant_group(node):
    group = ReentrantCallbackGroup()
    inner = node.create_client(AddTwoInts, "inner", callback_group=group)

    def add(request, response):
        response.sum = request.a + request.b
        return response

    async def twice(request, response):
        response.sum = 2 * (await inner.call_async(request)).sum
        return response

    node.create_service(AddTwoInts, "inner", add)
    node.create_service(AddTwoInts, "outer", twice, callback_group=group)
    client = node.create_client(AddTwoInts, "outer")
    future = client.call_async(AddTwoInts.Request(a=1, b=2))
    rclpy.spin_until_future_complete(node, future, timeout_sec=5)
    assert future.result().sum == 6


def test_a_callback_that_spins_until_a_call_is_answered_leaves_its_node_with_the_outer_spin(node):
    group = ReentrantCallbackGroup()
    node.create_service(AddTwoInts, "add", lambda request, response: response, callback_group=group)
    client = node.create_client(AddTwoInts, "add", callback_group=group)
    assert client.wait_for_service(60)
    answered = []

    def callback():
        future = client.call_async(AddTwoInts.Request())
        rclpy.spin_until_future_complete(node, future, timeout_sec=5)
        answered.append(future.done())
        if len(answered) == 2:
            rclpy.shutdown()

    node.create_timer(0.001, callback)
    rclpy.spin(node)
    assert answered == [True, True]


def test_spinning_once_without_waiting_serves_messages_from_the_same_program(node):
    calls, answers, seen = [], [], []
    node.create_service(AddTwoInts, "add", lambda request, answer: calls.append(1) or answer)
    client = node.create_client(AddTwoInts, "add")
    node.create_subscription(Empty, "news", seen.append, 10)
    publisher = node.create_publisher(Empty, "news", 10)
    assert client.wait_for_service(60)
    while not publisher.get_subscription_count():
        rclpy.spin_once(node, timeout_sec=0.01)
    publisher.publish(Empty())
    rclpy.spin_once(node, timeout_sec=0)
    assert seen == [Empty()]
    client.handle.set_on_new_response_callback(answers.append)
    client.call_async(AddTwoInts.Request())
    rclpy.spin_once(node, timeout_sec=0)
    assert (calls, answers) == ([1], [1])


def test_a_task_that_waits_goes_on_when_another_node_is_spun(node):
    """The global executor keeps tasks from one spin to the next."""
    future, seen = Future(), []

    async def callback():
        timer.cancel()
        seen.append(await future)

    timer = node.create_timer(0, callback)
    rclpy.spin_once(node, timeout_sec=1)
    future.set_result("went on")
    rclpy.spin_once(node, timeout_sec=1)
    assert seen == ["went on"]


def test_a_shutdown_in_a_callback_ends_spin(node):
    node.create_timer(0, rclpy.shutdown)
    rclpy.spin(node)
    assert not rclpy.ok()


def shut_down_soon(node):
    """Have another thread shut rclpy down once the node is spun."""
    begin = threading.Timer(0.02, rclpy.shutdown).start
    node.create_guard_condition(begin).trigger()


def test_a_shutdown_by_another_thread_ends_spin_of_an_executor_with_an_exception(node):
    shut_down_soon(node)
    rclpy.spin(node, MultiThreadedExecutor(2))
    rclpy.init(args=[])
    again = rclpy.create_node("again")
    shut_down_soon(again)
    with pytest.raises(ExternalShutdownException):
        rclpy.spin(again, SingleThreadedExecutor())


def test_a_shutdown_by_another_thread_ends_spin_of_the_global_executor_quietly(node):
    shut_down_soon(node)
    rclpy.spin(node)


def test_entities_created_while_another_thread_spins_are_served(spinning):
    events = [threading.Event() for _ in range(4)]

    class Own(Waitable):
        def add_to_wait_set(self, wait_set):
            events[0].set()

        def is_ready(self, wait_set):
            return False

    def serve(request, response):
        events[1].set()
        return response

    spinning.add_waitable(Own(ReentrantCallbackGroup()))
    spinning.create_service(AddTwoInts, "late", serve)
    client = spinning.create_client(AddTwoInts, "late")
    assert client.wait_for_service(60)
    client.call_async(AddTwoInts.Request())
    spinning.create_guard_condition(events[2].set).trigger()
    spinning.create_timer(0.01, events[3].set)
    assert [event.wait(60) for event in events] == [True] * 4


def test_a_rate_sleeps_while_another_thread_spins(spinning):
    rate = spinning.create_rate(100)
    for _ in range(3):
        rate.sleep()
    assert spinning.destroy_rate(rate)


def test_a_rate_in_a_callback_of_the_only_thread_is_refused(node):
    rate = node.create_rate(100)
    node.create_timer(0.001, rate.sleep)
    with pytest.raises(WouldDeadlock, match=r"Rate.sleep in .* waits for a timer, and blocks"):
        rclpy.spin(node)


def test_a_rate_in_a_callback_of_a_pool_sleeps(node):
    rate, slept = node.create_rate(100), Future()

    def callback():
        rate.sleep()
        slept.set_result(True)

    timer = node.create_timer(0.001, lambda: (timer.cancel(), callback()))
    with MultiThreadedExecutor(2) as executor:
        executor.add_node(node)
        executor.spin_until_future_complete(slept, 60)
    assert slept.done()


def test_an_unspun_rate_continues_in_time_and_warns_once(node, monkeypatch, capfd):
    monkeypatch.setattr(timer_module, "_GRACE_NS", 1)
    rate, begin = node.create_rate(50), time.monotonic()
    for _ in range(3):
        rate.sleep()
    assert 0.06 <= time.monotonic() - begin < 5
    assert capfd.readouterr().err.count("hang here for ever: Rate.sleep waits for a timer") == 1


def test_with_like_ros_an_unspun_rate_sleeps_until_the_end(node, monkeypatch):
    monkeypatch.setattr(timer_module, "_GRACE_NS", 1)
    monkeypatch.setattr(timer_module, "like_ros", lambda: True)
    rate = node.create_rate(100)
    threading.Timer(0.3, rclpy.shutdown).start()
    with pytest.raises(ROSInterruptException):
        rate.sleep()


def test_a_blocking_call_beside_the_spinning_thread_is_answered(spinning):
    spinning.create_service(AddTwoInts, "add", lambda request, response: response)
    client = spinning.create_client(AddTwoInts, "add")
    assert client.call(AddTwoInts.Request(), 5) == AddTwoInts.Response()


def test_a_callback_in_a_pool_may_block_for_a_call_in_another_group(node):
    inner = node.create_client(AddTwoInts, "inner", callback_group=ReentrantCallbackGroup())

    def relay(request, response):
        return inner.call(request, 5)

    node.create_service(
        AddTwoInts,
        "inner",
        lambda request, response: response,
        callback_group=ReentrantCallbackGroup(),
    )
    node.create_service(AddTwoInts, "outer", relay)
    with MultiThreadedExecutor(3) as executor:
        executor.add_node(node)
        client = node.create_client(AddTwoInts, "outer", callback_group=ReentrantCallbackGroup())
        future = client.call_async(AddTwoInts.Request())
        executor.spin_until_future_complete(future, 60)
        assert future.done()


def test_a_second_executor_takes_the_node_from_the_first(node):
    one, two = SingleThreadedExecutor(), SingleThreadedExecutor()
    assert one.add_node(node)
    assert two.add_node(node)
    assert (one.get_nodes(), two.get_nodes(), node.executor) == ([], [node], two)
