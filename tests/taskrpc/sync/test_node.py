"""Blocking programs get the same answers and errors, from any thread, and never hang."""

import asyncio
import os
import subprocess
import sys
import threading
import time
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor, wait

import pytest

import srvgen
import taskrpc
import taskrpc.sync
from taskrpc.wire.session import LAST_CALL_ID

pytestmark = pytest.mark.real_time

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")


def add(request, response):
    response.sum = request.a + request.b
    return response


@pytest.fixture
def node():
    with taskrpc.sync.Node("blocking") as node:
        yield node


def test_a_call_blocks_until_the_response_is_there(node):
    node.create_service(AddTwoInts, "add", add)
    client = node.create_client(AddTwoInts, "add")
    assert client.wait_for_service(timeout=60)
    assert client.call(AddTwoInts.Request(a=2, b=3)).sum == 5


def test_many_threads_may_share_one_client(node):
    node.create_service(AddTwoInts, "add", add, concurrency=4)
    client = node.create_client(AddTwoInts, "add")
    with ThreadPoolExecutor(8) as threads:
        sums = threads.map(lambda n: client.call(AddTwoInts.Request(a=n, b=n)).sum, range(200))
        assert list(sums) == [2 * n for n in range(200)]


def test_errors_are_those_of_the_async_client(node):
    def refuse(request, response):
        raise taskrpc.HandlerError("NOT_FOUND", "no such thing")

    node.create_service(AddTwoInts, "refuse", refuse)
    with pytest.raises(taskrpc.HandlerFailed, match="no such thing"):
        node.create_client(AddTwoInts, "refuse").call(AddTwoInts.Request())
    with pytest.raises(taskrpc.ServiceUnavailable):
        node.create_client(AddTwoInts, "nobody").call(AddTwoInts.Request())
    with pytest.raises(taskrpc.InvalidRequest, match="a: expected int64"):
        node.create_client(AddTwoInts, "refuse").call(AddTwoInts.Request(a="x"))


def test_a_deadline_ends_the_wait_although_the_callback_goes_on(node):
    release = threading.Event()

    def stuck(request, response):
        release.wait(300)
        return response

    node.create_service(AddTwoInts, "stuck", stuck)
    client = node.create_client(AddTwoInts, "stuck")
    assert client.wait_for_service(timeout=60)
    with pytest.raises(taskrpc.DeadlineExceeded):
        client.call(AddTwoInts.Request(), timeout=0.05)
    release.set()


def test_a_callback_may_call_another_service(node):
    node.create_service(AddTwoInts, "add", add)
    inner = node.create_client(AddTwoInts, "add")

    def twice(request, response):
        response.sum = 2 * inner.call(request).sum
        return response

    node.create_service(AddTwoInts, "twice", twice)
    assert node.create_client(AddTwoInts, "twice").call(AddTwoInts.Request(a=1, b=2)).sum == 6


def test_a_blocking_call_on_the_loops_own_thread_is_an_error_and_not_a_deadlock(node):
    node.create_service(AddTwoInts, "add", add)
    inner = node.create_client(AddTwoInts, "add")
    seen = []

    async def deadlock(request, response):
        for attempt in (lambda: inner.call(request), inner.wait_for_service, node.graph):
            with pytest.raises(taskrpc.WouldDeadlock) as caught:
                attempt()
            seen.append(str(caught.value))
        return response

    node.create_service(AddTwoInts, "deadlock", deadlock)
    node.create_client(AddTwoInts, "deadlock").call(AddTwoInts.Request())
    assert len(seen) == 3
    assert "would wait for ever" in seen[0]


def test_cancelling_the_future_cancels_the_call(node):
    cancelled = threading.Event()

    def patient(request, response):
        while not taskrpc.current_call().cancelled:
            time.sleep(0.001)
        cancelled.set()
        return response

    node.create_service(AddTwoInts, "patient", patient)
    client = node.create_client(AddTwoInts, "patient")
    assert client.wait_for_service(60)
    future = client.call_async(AddTwoInts.Request())
    while not future.cancel():
        pass
    with pytest.raises(CancelledError):
        future.result(60)
    if client.call_async(AddTwoInts.Request(), timeout=0.2).exception(5):
        assert cancelled.wait(60)


def test_ctrl_c_reaches_a_program_that_waits(tmp_path):
    program = tmp_path / "waits.py"
    program.write_text(
        "import _thread, threading, srvgen, taskrpc.sync\n"
        "T = srvgen.load('std_srvs/srv/Trigger')\n"
        "with taskrpc.sync.Node('waits') as node:\n"
        "    client = node.create_client(T, 'nobody')\n"
        "    threading.Timer(0.3, _thread.interrupt_main).start()\n"
        "    try:\n"
        "        client.wait_for_service()\n"
        "    except KeyboardInterrupt:\n"
        "        print('interrupted')\n"
    )
    done = subprocess.run(
        [sys.executable, program], capture_output=True, text=True, timeout=120, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "interrupted\n", "")


def test_a_call_at_the_very_end_of_a_program_is_refused_and_does_not_hang_it(tmp_path):
    """What atexit calls after the loop has stopped learns that nobody would answer."""
    program = tmp_path / "ends.py"
    program.write_text(
        "import atexit, srvgen, taskrpc.sync\n"
        "T = srvgen.load('std_srvs/srv/Trigger')\n"
        "def last():\n"
        "    for attempt in (client.call, client.call_async):\n"
        "        try:\n"
        "            attempt(T.Request())\n"
        "        except taskrpc.WouldDeadlock as error:\n"
        "            print(error)\n"
        "atexit.register(last)\n"
        "node = taskrpc.sync.Node('ends')\n"
        "node.__enter__()\n"
        "node.create_service(T, 'done', lambda request, response: response)\n"
        "client = node.create_client(T, 'done')\n"
        "client.call(T.Request())\n"
    )
    done = subprocess.run(
        [sys.executable, program], capture_output=True, text=True, timeout=120, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.count("the program is ending") == 2


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system cannot fork")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_forked_process_is_told_that_the_node_is_its_parents(node):
    client = node.create_client(AddTwoInts, "nobody")
    told, tell = os.pipe()
    if (child := os.fork()) == 0:
        problem = "none"
        try:
            client.call_async(AddTwoInts.Request())
        except taskrpc.WouldDeadlock as error:
            problem = str(error)
        os.write(tell, problem.encode())
        os._exit(0)
    os.waitpid(child, 0)
    os.close(tell)
    with open(told, "rb") as pipe:
        assert b"call_async(): this node belongs to the parent process" in pipe.read()


class Stingy:
    """A socket that takes a few bytes of each message, or none, as a full one does."""

    def __init__(self, socket, takes):
        self.socket = socket
        self.takes = takes
        self.asked = 0

    def send(self, data):
        self.asked += 1
        if self.takes == 0:
            raise BlockingIOError
        return self.socket.send(data[: self.takes])

    def close(self):
        self.socket.close()


@pytest.mark.parametrize("takes", [0, 3, 17])
def test_what_the_socket_does_not_take_at_once_is_sent_by_the_loop(node, takes):
    node.create_service(AddTwoInts, "add", add, concurrency=4)
    client = node.create_client(AddTwoInts, "add")
    assert client.wait_for_service(timeout=60)
    here = client._inner._channel._connection._here
    here._socket = stingy = Stingy(here._socket, takes)
    with ThreadPoolExecutor(8) as threads:
        sums = threads.map(lambda n: client.call(AddTwoInts.Request(a=n, b=n)).sum, range(300))
        assert list(sums) == [2 * n for n in range(300)]
    assert stingy.asked > 10


def test_a_caller_writes_to_the_socket_itself(node):
    node.create_service(AddTwoInts, "add", add)
    client = node.create_client(AddTwoInts, "add")
    assert client.wait_for_service(timeout=60)
    here = client._inner._channel._connection._here
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


def test_a_thread_that_waits_learns_that_its_server_is_gone():
    began, release = threading.Event(), threading.Event()

    def stuck(request, response):
        began.set()
        release.wait(300)
        return response

    with taskrpc.sync.Node("caller") as caller, taskrpc.sync.Node("server") as server:
        server.create_service(AddTwoInts, "stuck", stuck)
        client = caller.create_client(AddTwoInts, "stuck")
        assert client.wait_for_service(timeout=60)
        with ThreadPoolExecutor(1) as threads:
            waiting = threads.submit(client.call, AddTwoInts.Request(), timeout=30)
            assert began.wait(60)
            server.destroy()
            with pytest.raises(taskrpc.OutcomeUnknown):
                waiting.result(60)
            release.set()


def test_a_short_deadline_behind_a_long_one_is_kept(node):
    release = threading.Event()

    def stuck(request, response):
        release.wait(300)
        return response

    node.create_service(AddTwoInts, "stuck", stuck, concurrency=2)
    client = node.create_client(AddTwoInts, "stuck")
    assert client.wait_for_service(timeout=60)
    with ThreadPoolExecutor(1) as threads:
        patient = threads.submit(client.call, AddTwoInts.Request(), timeout=30)
        began = time.monotonic()
        with pytest.raises(taskrpc.DeadlineExceeded):
            client.call(AddTwoInts.Request(), timeout=0.1)
        assert 0.1 <= time.monotonic() - began < 5
        release.set()
        patient.result(60)


def test_a_call_on_its_way_while_its_service_moves_reaches_that_service_and_no_other():
    """A method number of one server's means another service on another's connection."""
    reached = []

    def noting(name):
        def callback(request, response):
            reached.append(name)
            return response

        return callback

    with (
        taskrpc.sync.Node("old", token="old") as old,
        taskrpc.sync.Node("new", token="new") as new,
        taskrpc.sync.Node("caller", token="caller") as caller,
    ):
        moving = old.create_service(AddTwoInts, "moving", noting("old moving"))
        for node, name in ((old, "other"), (new, "third")):
            node.create_service(AddTwoInts, name, noting(name))
        clients = [caller.create_client(AddTwoInts, name) for name in ("moving", "other", "third")]
        for client in clients:
            assert client.wait_for_service(timeout=60)
            client.call(AddTwoInts.Request())
        reached.clear()
        channel = clients[0]._inner._channel
        encode = channel._encode

        def encode_late(request):
            if threading.current_thread() is threading.main_thread():
                old._loop.do(moving.destroy, "destroy()")
                new.create_service(AddTwoInts, "moving", noting("new moving"))
                assert clients[0].wait_for_service(timeout=60)
            return encode(request)

        channel._encode = encode_late
        clients[0].call(AddTwoInts.Request())
    assert reached == ["new moving"]


def test_a_connection_that_threads_call_on_retires_in_time(node):
    """Numbers of calls never come again on one connection, and never outgrow their field."""
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
def test_the_loop_waits_for_a_thread_that_begins_a_call(node, what):
    """Else it would look through calls, or number one of its own, while the thread adds one."""
    node.create_service(AddTwoInts, "add", add)
    client = node.create_client(AddTwoInts, "add")
    assert client.wait_for_service(timeout=60)
    connection = client._inner._channel._connection
    done = threading.Event()

    def act():
        getattr(connection, what)()
        done.set()

    with connection._mine:
        node._loop.soon(act)
        assert not done.wait(0.05)
    assert done.wait(60)


def test_deadlines_that_threads_tell_of_at_the_same_time_are_all_kept(node):
    """The loop hears of several at once: a later one must not take the place of an earlier."""
    node.create_service(AddTwoInts, "add", add)
    client = node.create_client(AddTwoInts, "add")
    assert client.wait_for_service(timeout=60)
    connection = client._inner._channel._connection
    planned = []

    def tell():
        now = node._loop._loop.time()
        for span in (0.5, 30.0):
            connection.watch(now + span)
        planned.append(connection.look_before - now)

    node._loop.do(tell, "tell()")
    assert planned[0] < 1


def test_whoever_waits_for_several_futures_learns_of_one_that_never_began(node):
    client = node.create_client(AddTwoInts, "nobody")
    node._loop.soon(lambda: time.sleep(0.05))
    future = client.call_async(AddTwoInts.Request())
    assert future.cancel()
    assert wait([future], timeout=60).done == {future}


def test_a_function_is_told_of_each_answer_in_the_order_of_the_calls(node):
    node.create_service(AddTwoInts, "add", add)
    client = node.create_client(AddTwoInts, "add")
    told, all_told = [], threading.Event()

    def tell(response, error):
        told.append((response.sum, error))
        if len(told) == 20:
            all_told.set()

    for n in range(20):  # the first go by the loop, which finds the service, the others directly
        client.call_then(AddTwoInts.Request(a=n), tell)
        if n == 10:
            assert client.wait_for_service(60)
    assert all_told.wait(60)
    assert told == [(n, None) for n in range(20)]


class Sending:
    """A transport that takes what is left out of its buffer before it sends it.

    As asyncio's on Windows does: meanwhile it calls the buffer empty.
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


def test_a_thread_sends_nothing_while_the_transport_sends_what_was_left(node):
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


def test_answers_that_come_together_are_told_in_the_order_of_the_calls(node):
    """Before the first call the connection has to be made; before the second it is there."""
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


def test_a_function_is_told_of_an_error(node):
    told = []
    heard = threading.Event()

    def tell(response, error):
        told.append((response, type(error)))
        heard.set()

    node.create_client(AddTwoInts, "nobody").call_then(AddTwoInts.Request(), tell)
    assert heard.wait(60)
    assert told == [(None, taskrpc.ServiceUnavailable)]


def test_a_call_that_was_given_up_is_told_to_nobody_and_cancelled_at_the_server(node):
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
    for _ in range(2):  # once by the loop, once directly
        give_up = client.call_then(AddTwoInts.Request(), lambda *end: told.append(end))
        assert begun.wait(60)
        give_up()
        assert cancelled.wait(60)
        begun.clear()
        cancelled.clear()
    assert told == []


def test_threads_answer_a_deferred_service(node):
    threads = ThreadPoolExecutor(4)
    answer = lambda call: call.reply(AddTwoInts.Response(sum=call.request.a))  # noqa: E731
    node.create_deferred_service(AddTwoInts, "add", lambda call: threads.submit(answer, call))
    client = node.create_client(AddTwoInts, "add")
    assert [client.call(AddTwoInts.Request(a=n)).sum for n in range(50)] == list(range(50))
    threads.shutdown()


def test_a_node_can_be_started_and_closed_without_with():
    node = taskrpc.sync.Node("notebook").start()
    try:
        node.create_service(AddTwoInts, "add", add)
        assert node.create_client(AddTwoInts, "add").call(AddTwoInts.Request(a=2, b=3)).sum == 5
    finally:
        node.close()
    node.close()
    with pytest.raises(taskrpc.TaskRpcError, match=r"has not started; write .* `node.start\(\)`"):
        node.create_client(AddTwoInts, "add")
