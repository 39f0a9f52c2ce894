"""Threads send calls on a connection themselves, in order, while the event loop uses it too."""

import asyncio
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor

import pytest

import srvgen
import taskrpc
import taskrpc.sync
from taskrpc.core.wire.session import LAST_CALL_ID

pytestmark = pytest.mark.real_time


AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")


def add(request, response):
    response.sum = request.a + request.b
    return response


@pytest.fixture
def node():
    with taskrpc.sync.Node("blocking") as node:
        yield node


class Stingy:
    """A socket that accepts a few bytes of each message, or none, as if its buffer were full."""

    def __init__(self, socket, takes):
        self.socket = socket
        self.takes = takes
        self.asked = 0

    def send(self, data):
        self.asked += 1
        if self.takes == 0:
            raise BlockingIOError
        return self.socket.send(data[: self.takes])

    def __getattr__(self, name):
        return getattr(self.socket, name)


@pytest.mark.parametrize("takes", [0, 3, 17])
def test_loop_sends_the_bytes_that_the_socket_did_not_accept(node, takes):
    node.create_service(AddTwoInts, "add", add, concurrency=4)
    client = node.create_client(AddTwoInts, "add")
    assert client.wait_for_service(timeout=60)
    here = client._inner._channel._connection._thread_socket
    here._socket = stingy = Stingy(here._socket, takes)
    with ThreadPoolExecutor(8) as threads:
        sums = threads.map(lambda n: client.call(AddTwoInts.Request(a=n, b=n)).sum, range(300))
        assert list(sums) == [2 * n for n in range(300)]
    assert stingy.asked > 10


def test_calling_thread_writes_to_the_socket_itself(node):
    node.create_service(AddTwoInts, "add", add)
    client = node.create_client(AddTwoInts, "add")
    assert client.wait_for_service(timeout=60)
    here = client._inner._channel._connection._thread_socket
    here._socket = stingy = Stingy(here._socket, 10**6)
    for n in range(20):
        assert client.call(AddTwoInts.Request(a=n, b=n)).sum == 2 * n
    assert stingy.asked == 20


def test_calls_from_threads_and_from_the_loop_do_not_disturb_each_other(node):
    node.create_service(AddTwoInts, "add", add, concurrency=8)
    client = node.create_client(AddTwoInts, "add")
    assert client.wait_for_service(timeout=60)

    def both(n):
        later = client.call_async(AddTwoInts.Request(a=n, b=1))
        now = client.call(AddTwoInts.Request(a=n, b=2))
        return later.result(60).sum, now.sum

    with ThreadPoolExecutor(8) as threads:
        assert list(threads.map(both, range(300))) == [(n + 1, n + 2) for n in range(300)]
    assert client._inner._channel._connection.session.in_flight == 0


def test_connection_is_replaced_when_threads_have_used_its_last_call_id(node):
    """No call id is used twice on one connection, or exceeds its field."""
    node.create_service(AddTwoInts, "add", add)
    client = node.create_client(AddTwoInts, "add")
    assert client.wait_for_service(timeout=60)
    first = client._inner._channel._connection
    first.session.last_call_id = LAST_CALL_ID - 3
    for n in range(6):
        assert client.call(AddTwoInts.Request(a=n)).sum == n
    assert first.session.last_call_id == LAST_CALL_ID
    assert client._inner._channel._connection is not first


@pytest.mark.parametrize("what", ["expiring", "resume_writing"])
def test_loop_waits_for_a_thread_that_begins_a_call(node, what):
    """Otherwise it would iterate over the calls, or send one, while the thread adds one."""
    node.create_service(AddTwoInts, "add", add)
    client = node.create_client(AddTwoInts, "add")
    assert client.wait_for_service(timeout=60)
    connection = client._inner._channel._connection
    done = threading.Event()

    def act():
        getattr(connection, what)()
        done.set()

    with connection._lock:
        node._loop.soon(act)
        assert not done.wait(0.05)
    assert done.wait(60)


def test_simultaneous_deadlines_of_several_threads_are_all_kept(node):
    """The loop gets several at once: a later one must not replace an earlier one."""
    node.create_service(AddTwoInts, "add", add)
    client = node.create_client(AddTwoInts, "add")
    assert client.wait_for_service(timeout=60)
    connection = client._inner._channel._connection
    planned = []

    def tell():
        now = node._loop._loop.time()
        for span in (0.5, 30.0):
            connection.watch(now + span)
        planned.append(connection.check_before - now)

    node._loop.do(tell, "tell()")
    assert planned[0] < 1


def test_functions_get_the_responses_in_the_order_of_the_calls(node):
    node.create_service(AddTwoInts, "add", add)
    client = node.create_client(AddTwoInts, "add")
    told, all_told = [], threading.Event()

    def tell(response, error):
        told.append((response.sum, error))
        if len(told) == 20:
            all_told.set()

    for n in range(20):  # the loop sends the first, since it finds the service; then this thread
        client.call_then(AddTwoInts.Request(a=n), tell)
        if n == 10:
            assert client.wait_for_service(60)
    assert all_told.wait(60)
    assert told == [(n, None) for n in range(20)]


class Sending:
    """A transport that removes the rest from its buffer before it sends it.

    asyncio's transport on Windows does this too: it already reports an empty buffer.
    """

    def __init__(self, transport):
        self._transport = transport
        self._left, self._is_taken, self.kept = [], False, threading.Event()

    def __getattr__(self, name):
        return getattr(self._transport, name)

    def write(self, data):
        self._left.append(data)
        self.kept.set()

    def get_write_buffer_size(self):
        return 0 if self._is_taken else sum(map(len, self._left))

    def take(self):
        self._is_taken = True

    def send(self):
        self._transport.writelines(self._left)
        self.write = self._transport.write


def test_thread_sends_nothing_while_the_transport_sends_the_rest(node):
    node.create_service(AddTwoInts, "add", add)
    client = node.create_client(AddTwoInts, "add")
    assert client.call(AddTwoInts.Request(a=1)).sum == 1
    connection = client._inner._channel._connection
    connection.transport = sending = Sending(connection.transport)
    first = client.call_async(AddTwoInts.Request(a=2))
    assert sending.kept.wait(60)
    node._loop.do(sending.take, "take()")
    second = Future()
    client.call_then(AddTwoInts.Request(a=3), lambda response, _: second.set_result(response))
    node._loop.do(sending.send, "send()")
    assert [future.result(60).sum for future in (first, second)] == [2, 3]
    connection.transport = sending._transport


def test_simultaneous_responses_arrive_in_the_order_of_the_calls(node):
    """The first call makes the connection; the second uses it."""
    arrived, opened, loops = threading.Semaphore(0), asyncio.Event(), []

    async def wait(request, response):
        loops.append(asyncio.get_running_loop())
        arrived.release()
        await opened.wait()
        response.sum = request.a
        return response

    node.create_service(AddTwoInts, "wait", wait, concurrency=2)
    client = node.create_client(AddTwoInts, "wait")
    told, all_told = [], threading.Event()

    def tell(response, error):
        told.append((response and response.sum, error))
        if len(told) == 2:
            all_told.set()

    for n in range(2):
        client.call_then(AddTwoInts.Request(a=n), tell)
        assert arrived.acquire(timeout=60)
    loops[0].call_soon_threadsafe(opened.set)  # both callbacks end in one turn of the loop
    assert all_told.wait(60)
    assert told == [(0, None), (1, None)]


def test_function_gets_the_error_of_its_call(node):
    told = []
    heard = threading.Event()

    def tell(response, error):
        told.append((response, type(error)))
        heard.set()

    node.create_client(AddTwoInts, "nobody").call_then(AddTwoInts.Request(), tell)
    assert heard.wait(60)
    assert told == [(None, taskrpc.ServiceUnavailable)]


def test_cancelled_call_is_not_reported_and_is_cancelled_at_the_server(node):
    begun, cancelled = threading.Event(), threading.Event()

    def wait(request, response):
        begun.set()
        while not taskrpc.current_call().cancelled:
            time.sleep(0.01)
        cancelled.set()
        return response

    node.create_service(AddTwoInts, "wait", wait)
    client = node.create_client(AddTwoInts, "wait")
    told = []
    for _ in range(2):  # first the loop sends the call, then this thread
        cancel = client.call_then(AddTwoInts.Request(), lambda *end: told.append(end))
        assert begun.wait(60)
        cancel()
        assert cancelled.wait(60)
        begun.clear()
        cancelled.clear()
    assert told == []
