"""Clients call, wait and cancel as in rclpy, and also report errors that ROS does not report."""

import contextlib
import gc
import subprocess
import sys
import threading

import pytest

from taskrpc.errors import HandlerFailed, InvalidRequest, OutcomeUnknown
from taskrpc.ros.packages.rclpy.exceptions import (
    InvalidHandle,
    InvalidServiceNameException,
    RCLError,
)
from tests.ros.packages.rclpy.living import PATIENCE, AddTwoInts, add, service_of, until

pytestmark = pytest.mark.real_time

Request = AddTwoInts.Request


def test_a_response_arrives_while_a_thread_spins(world, client):
    future = client.call_async(Request(a=1, b=2))
    assert not future.done()
    assert world.answer(future).sum == 3


def test_each_of_many_calls_gets_its_own_response(world, client):
    futures = [client.call_async(Request(a=number, b=1)) for number in range(64)]
    assert [world.answer(future).sum for future in futures] == list(range(1, 65))


def test_calls_leave_no_reference_cycles(world, client):
    world.answer(client.call_async(Request()))
    gc.collect()
    gc.disable()
    try:
        for number in range(100):
            world.answer(client.call_async(Request(a=number)))
        assert gc.collect() < 100
    finally:
        gc.enable()


def test_a_call_blocks_while_another_thread_spins(world, client):
    spinning = threading.Thread(target=world.executor.spin)
    spinning.start()
    try:
        assert client.call(Request(a=2, b=3), timeout_sec=PATIENCE).sum == 5
    finally:
        world.executor.shutdown()
        spinning.join()


def test_a_call_times_out_and_is_no_longer_pending(world):
    client = world.node("caller").create_client(AddTwoInts, "nobody")
    with pytest.raises(TimeoutError):
        client.call(Request(), timeout_sec=0.05)
    with pytest.raises(KeyError):
        client.get_pending_request(1)


def test_a_request_of_another_type_is_refused(client):
    for request in (AddTwoInts.Response(), "text", Request):
        with pytest.raises(TypeError, match="expected a AddTwoInts_Request for /add"):
            client.call_async(request)
        with pytest.raises(TypeError):
            client.call(request)


def test_invalid_value_is_refused_and_leaves_no_pending_request(client):
    with pytest.raises(InvalidRequest, match="a: expected int64"):
        client.call_async(Request(a="x"))
    with pytest.raises(KeyError):
        client.get_pending_request(1)


def test_waiting_ends_at_the_timeout_and_at_the_shutdown(world):
    client = world.node("caller").create_client(AddTwoInts, "nobody")
    assert client.wait_for_service(timeout_sec=0) is False
    assert client.wait_for_service(0.05) is False
    threading.Timer(0.1, world.context.shutdown).start()
    with pytest.raises((InvalidHandle, RCLError)):  # as in ROS: a loop around it ends
        client.wait_for_service()


def test_a_removed_request_stays_as_it_is(world, client):
    future = client.call_async(Request(a=1, b=2))
    client.remove_pending_request(future)
    assert world.answer(client.call_async(Request(a=1, b=1))).sum == 2
    assert not future.done()
    assert not future.cancelled()


def test_cancelled_request_gets_no_response(world, client):
    future = client.call_async(Request(a=1, b=2))
    future.cancel()
    assert world.answer(client.call_async(Request(a=1, b=1))).sum == 2
    assert future.cancelled()
    assert not future.done()
    assert future.result() is None


def test_the_caller_learns_that_the_callback_raised(world):
    def fail(request, response):
        raise ValueError("boom")

    world.node("server").create_service(AddTwoInts, "add", fail)
    client = world.node("caller").create_client(AddTwoInts, "add")
    future = client.call_async(Request())
    with pytest.raises(ValueError, match="boom"):
        world.answer(future)
    world.executor.spin_until_future_complete(future, PATIENCE)
    with pytest.raises(HandlerFailed, match="the callback of /add raised ValueError: boom"):
        future.result()


def test_the_caller_learns_that_the_server_has_ended(world):
    server = world.node("server")
    server.create_service(AddTwoInts, "add", add)
    client = world.node("caller").create_client(AddTwoInts, "add")
    assert client.wait_for_service(PATIENCE)
    world.executor.remove_node(server)  # so that no response is sent
    future = client.call_async(Request())
    service = service_of(server, "/add")
    world.spin_until(service.has_work)
    service.handle.service_take_request(Request)
    server.destroy_node()
    world.executor.spin_until_future_complete(future, PATIENCE)
    assert isinstance(future.exception(), OutcomeUnknown)


SERVER = """
import threading

import srvgen
from taskrpc.ros.packages import rclpy

srv_type = srvgen.load("example_interfaces/srv/AddTwoInts")


def add(request, response):
    if request.b == 9:
        threading.Event().wait()
    response.sum = request.a + request.b
    return response


rclpy.init(args=[])
node = rclpy.create_node("server")
node.create_service(srv_type, "add", add)
print("ready", flush=True)
rclpy.spin(node)
"""


@contextlib.contextmanager
def server_elsewhere():
    """A server in another process, which is killed at the end."""
    command = [sys.executable, "-c", SERVER]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "ready\n"
        try:
            yield process
        finally:
            process.kill()


def test_a_client_survives_its_killed_server_and_calls_the_next_one(world):
    client = world.node("caller").create_client(AddTwoInts, "add")
    with server_elsewhere() as server:
        assert client.wait_for_service(PATIENCE)
        assert world.answer(client.call_async(Request(a=1, b=1))).sum == 2
        lost = client.call_async(Request(a=1, b=9))
        world.executor.spin_until_future_complete(lost, 0.2)
        server.kill()
        world.executor.spin_until_future_complete(lost, PATIENCE)
        assert isinstance(lost.exception(), OutcomeUnknown)
    until(lambda: not client.service_is_ready())
    waiting = client.call_async(Request(a=2, b=2))
    with server_elsewhere():
        assert world.answer(waiting).sum == 4


def test_destroyed_client_refuses_calls(world, client):
    assert client.parent_node.destroy_client(client)
    with pytest.raises(InvalidHandle, match="cannot use Destroyable"):
        client.call_async(Request())
    assert not client.parent_node.destroy_client(client)


def test_end_of_a_with_block_destroys_the_client(world):
    node = world.node()
    with node.create_client(AddTwoInts, "add") as client:
        assert client in node.clients
    assert client not in node.clients


def test_done_callbacks_run_on_the_spinning_thread(world, client):
    threads = []
    future = client.call_async(Request())
    future.add_done_callback(lambda _: threads.append(threading.current_thread()))
    world.spin_until(lambda: threads)
    assert threads == [threading.current_thread()]


def test_bad_service_names_are_refused_with_the_messages_of_ros(world):
    with pytest.raises(InvalidServiceNameException, match="must not contain characters"):
        world.node().create_client(AddTwoInts, "get/parameters?")
    with pytest.raises(ValueError, match="unknown substitution"):
        world.node("other").create_client(AddTwoInts, "foo/{bad_sub}")


@pytest.mark.parametrize(
    ("namespace", "rule", "name", "whole"),
    [
        (None, "a:=b", "service", "/service"),
        ("ns", "a:=b", "service", "/ns/service"),
        ("my/ns", "a:=b", "x/service", "/my/ns/x/service"),
        ("/my/ns", "a:=b", "/service", "/service"),
        ("ns", "service:=new", "service", "/ns/new"),
        (None, "service:=x/new", "service", "/x/new"),
    ],
)
def test_the_name_is_expanded_and_remapped(world, namespace, rule, name, whole):
    node = world.node(namespace=namespace, cli_args=["--ros-args", "-r", rule])
    client = node.create_client(AddTwoInts, name)
    assert (client.service_name, client.srv_name) == (whole, name)
