"""Requests are sent in the order of the calls, at once or when their server is found."""

import contextlib
import subprocess
import sys
import textwrap
import threading
import time

import pytest

from taskrpc.ros.packages.rclpy._impl.bridge import NativeClient
from tests.ros.packages.rclpy.living import AddTwoInts, add, living, service_of, until

pytestmark = pytest.mark.real_time


Request = AddTwoInts.Request


def test_a_request_waits_for_a_server_that_comes_later(world):
    client = world.node("caller").create_client(AddTwoInts, "add")
    request = Request(a=1, b=1)
    first = client.call_async(request)
    request.a = 10  # what was called is not changed by this
    second = client.call_async(request)
    assert not client.service_is_ready()
    world.node("server").create_service(AddTwoInts, "add", add)
    assert [world.answer(first).sum, world.answer(second).sum] == [2, 11]


@pytest.fixture
def sent_by_the_loop(monkeypatch):
    """The loop sends the next request, the caller those after it: it finds the connection there."""
    connected = NativeClient.connected.fget
    to_the_caller = iter([False])

    def seen(native):
        here = threading.current_thread() is threading.main_thread()
        return next(to_the_caller, True) if here else connected(native)

    return lambda: monkeypatch.setattr(NativeClient, "connected", property(seen))


def test_no_request_overtakes_one_that_waits_for_the_connection(
    world, client, monkeypatch, sent_by_the_loop
):
    world.answer(client.call_async(Request()))
    came = []
    service = service_of(next(iter(world.executor.get_nodes())), "/add")
    monkeypatch.setattr(service, "callback", lambda request, response: came.append(request.a))
    sent_by_the_loop()
    client._native.bridge.soon(lambda: time.sleep(0.05))
    for number in (1, 2, 3):
        client.call_async(Request(a=number))
    for _ in range(3):
        with contextlib.suppress(TypeError):  # nothing is returned
            world.spin_until(lambda: len(came) == 3)
    assert came == [1, 2, 3]


def test_no_answer_overtakes_that_of_one_that_waited_for_the_connection(
    world, client, sent_by_the_loop
):
    """It hears sooner of the answers to what the caller itself has sent."""
    world.answer(client.call_async(Request()))
    sent_by_the_loop()
    service = service_of(next(iter(world.executor.get_nodes())), "/add")
    answered, futures = [], []
    for number in (1, 2, 3):
        futures.append(client.call_async(Request(a=number)))
        futures[-1].add_done_callback(lambda done: answered.append(done.result().sum))
        until(lambda number=number: len(service._calls) == number)
    client._native.bridge.soon(lambda: time.sleep(0.1))  # so that it finds all answers at once
    world.spin_until(lambda: len(answered) == 3)
    assert answered == [1, 2, 3]


def test_a_program_that_ends_right_after_its_call_has_called():
    program = textwrap.dedent(
        """
        import sys
        import srvgen
        from taskrpc.ros.packages import rclpy

        rclpy.init(args=[])
        node = rclpy.create_node("short")
        srv_type = srvgen.load("example_interfaces/srv/AddTwoInts")
        node.create_client(srv_type, "add").call_async(srv_type.Request(a=7))
        """
    )
    seen = []

    def note(request, response):
        seen.append(request.a)
        return response

    with living() as world:
        world.node("server").create_service(AddTwoInts, "add", note)
        subprocess.run([sys.executable, "-c", program], check=True, timeout=120)
        world.spin_until(lambda: seen)
    assert seen == [7]
