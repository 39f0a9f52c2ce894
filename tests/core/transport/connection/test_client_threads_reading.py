"""Threads read the responses to their calls; the event loop reads all else, and again in time."""

import subprocess
import sys
import textwrap
import threading
from concurrent.futures import Future, ThreadPoolExecutor

import pytest

import srvgen
import taskrpc
import taskrpc.sync
from taskrpc.core.transport.connection import client_threads, threads
from taskrpc.core.transport.connection.client_threads import ThreadedConnection

pytestmark = [
    pytest.mark.real_time,
    pytest.mark.skipif(sys.platform == "win32", reason="threads do not read on Windows"),
]

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")
FOREVER = 3600


class Server:
    """Adds at once, or when the test says so."""

    def __init__(self):
        self.node = taskrpc.sync.Node("server", token="server").start()
        self.begun, self.may_end = threading.Event(), threading.Event()
        self.node.create_service(AddTwoInts, "add", self.add, threaded=False)
        self.node.create_service(AddTwoInts, "slow", self.slow)

    def add(self, request, response):
        response.sum = request.a + request.b
        return response

    def slow(self, request, response):
        self.begun.set()
        assert self.may_end.wait(60)
        return self.add(request, response)


@pytest.fixture
def server():
    made = Server()
    yield made
    made.may_end.set()
    made.node.close()


@pytest.fixture
def node(server):
    with taskrpc.sync.Node("client") as node:
        yield node


@pytest.fixture
def patient(monkeypatch):
    """A thread reads as long as it can, and the event loop never takes the reading back."""
    monkeypatch.setattr(threads, "READ_TIMEOUT", 1000 * FOREVER)
    monkeypatch.setattr(client_threads, "LEND_CHECK", FOREVER)


def client_that_reads(node, name="add"):
    """A client of this service on a connection from which threads read."""
    add, client = node.create_client(AddTwoInts, "add"), node.create_client(AddTwoInts, name)
    assert add.wait_for_service(60)
    assert client.wait_for_service(60)
    while not connection_of(add)._lent:
        assert add.call(AddTwoInts.Request(a=1, b=2)).sum == 3
    assert connection_of(client) is connection_of(add)
    return client


def connection_of(client):
    return client._inner._channel._connection


@pytest.fixture
def handled(monkeypatch):
    """The sizes of the reads that the event loop has handled for clients."""
    handled = []

    def buffer_updated(connection, nbytes):
        handled.append(nbytes)
        really(connection, nbytes)

    really = ThreadedConnection.buffer_updated
    monkeypatch.setattr(ThreadedConnection, "buffer_updated", buffer_updated)
    return handled


@pytest.mark.usefixtures("patient")
def test_event_loop_reads_nothing_while_threads_read_their_responses(handled, node):
    client = client_that_reads(node)
    before = len(handled)
    assert before >= client_threads.LEND_AFTER
    for n in range(50):
        assert client.call(AddTwoInts.Request(a=n, b=n)).sum == 2 * n
    assert len(handled) == before


def test_event_loop_reads_first_and_whenever_calls_overlap(handled, server, node):
    slow, add = (node.create_client(AddTwoInts, name) for name in ("slow", "add"))
    first = slow.call_async(AddTwoInts.Request(a=1))
    assert server.begun.wait(60)
    for n in range(3 * client_threads.LEND_AFTER):
        assert add.call(AddTwoInts.Request(a=n)).sum == n
    assert len(handled) >= 3 * client_threads.LEND_AFTER
    server.may_end.set()
    assert first.result(60).sum == 1


def test_event_loop_reads_again_when_threads_make_no_more_calls(node, monkeypatch):
    monkeypatch.setattr(threads, "READ_TIMEOUT", 1000 * FOREVER)
    reads = threading.Event()
    really = ThreadedConnection._read_again
    monkeypatch.setattr(
        ThreadedConnection, "_read_again", lambda connection: (really(connection), reads.set())
    )
    client = client_that_reads(node)
    assert reads.wait(60)
    assert client.call(AddTwoInts.Request(a=1)).sum == 1


@pytest.mark.usefixtures("patient")
def test_calls_of_other_callers_end_while_a_thread_reads(server, node):
    for _ in range(2):
        slow = client_that_reads(node, "slow")
        with ThreadPoolExecutor(1) as pool:
            waiting = pool.submit(slow.call, AddTwoInts.Request(a=1), timeout=None)
            assert server.begun.wait(60)
            add = node.create_client(AddTwoInts, "add")
            assert add.call_async(AddTwoInts.Request(a=2)).result(60).sum == 2
            assert add.call(AddTwoInts.Request(a=3)).sum == 3
            assert not waiting.done()
            server.may_end.set()
            assert waiting.result(60).sum == 1
        server.begun.clear()
        server.may_end.clear()


@pytest.mark.usefixtures("patient")
def test_function_runs_on_the_event_loop_though_a_thread_has_read_its_response(server, node):
    slow, told = client_that_reads(node, "slow"), Future()
    add = node.create_client(AddTwoInts, "add")
    assert add.wait_for_service(60)
    client_that_reads(node)
    with ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(slow.call, AddTwoInts.Request(a=1), timeout=None)
        assert server.begun.wait(60)
        add.call_then(
            AddTwoInts.Request(), lambda *_: told.set_result(threading.current_thread()), None
        )
        assert told.result(60) is node.loop_thread._thread
        server.may_end.set()
        assert waiting.result(60).sum == 1


@pytest.mark.usefixtures("patient")
def test_event_loop_reads_on_while_a_call_is_in_flight(server, node):
    """The last of the calls that were alone takes long, and another response comes first."""
    slow, add = (node.create_client(AddTwoInts, name) for name in ("slow", "add"))
    assert slow.wait_for_service(60)
    assert add.wait_for_service(60)
    for n in range(client_threads.LEND_AFTER - 1):
        assert add.call(AddTwoInts.Request(a=n)).sum == n
    with ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(slow.call, AddTwoInts.Request(a=1), timeout=None)
        assert server.begun.wait(60)
        assert add.call_async(AddTwoInts.Request(a=2)).result(60).sum == 2
        server.may_end.set()
        assert waiting.result(60).sum == 1


def test_event_loop_reads_on_while_a_node_is_subscribed(handled, server, node):
    heard = threading.Event()
    publisher = server.node.create_publisher(AddTwoInts.Request, "numbers")
    node.create_subscription(AddTwoInts.Request, "numbers", lambda _: heard.set())
    add = node.create_client(AddTwoInts, "add")
    assert add.wait_for_service(60)
    while not heard.wait(0.01):
        publisher.publish(AddTwoInts.Request(a=7))
    before = len(handled)
    for n in range(3 * client_threads.LEND_AFTER):
        assert add.call(AddTwoInts.Request(a=n)).sum == n
    assert len(handled) - before >= 3 * client_threads.LEND_AFTER


@pytest.mark.usefixtures("patient")
@pytest.mark.parametrize("way", ["call_async", "call_then"])
def test_call_without_a_waiting_thread_ends_although_threads_read(node, way):
    client = client_that_reads(node)
    if way == "call_async":
        response = client.call_async(AddTwoInts.Request(a=1), timeout=None)
    else:
        response = Future()
        client.call_then(AddTwoInts.Request(a=1), lambda end, _: response.set_result(end), None)
    assert response.result(60).sum == 1


@pytest.mark.usefixtures("patient")
@pytest.mark.parametrize("end", ["here", "at the server"])
def test_thread_that_reads_hears_of_the_end_of_its_connection(server, node, end):
    slow = client_that_reads(node, "slow")
    lost = connection_of(slow)
    with ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(slow.call, AddTwoInts.Request(a=1), timeout=None)
        assert server.begun.wait(60)
        served = server.node.async_node._transport._served
        ends = [lost] if end == "here" else list(served)
        error = taskrpc.ConnectionLost("lost by a test")
        node.loop_thread.soon(lambda: [each.abort(error) for each in ends])
        assert isinstance(waiting.exception(60), taskrpc.OutcomeUnknown)
    server.may_end.set()
    assert slow.call(AddTwoInts.Request(a=2)).sum == 2
    assert connection_of(slow) is not lost


def test_deadline_is_kept_on_a_connection_from_which_threads_read(server, node):
    slow = client_that_reads(node, "slow")
    for timeout in (0.02, 0.2):
        with pytest.raises(taskrpc.DeadlineExceeded):
            slow.call(AddTwoInts.Request(a=1), timeout=timeout)
    server.may_end.set()
    assert slow.call(AddTwoInts.Request(a=1)).sum == 1


def test_interrupted_thread_cancels_its_call_and_returns_the_reading(tmp_path):
    done = run(
        tmp_path,
        """
        import asyncio, signal, threading
        import srvgen, taskrpc.sync
        from taskrpc.core.transport.connection import client_threads, threads

        threads.READ_TIMEOUT, client_threads.LEND_CHECK = 500, 3600
        Add = srvgen.load("example_interfaces/srv/AddTwoInts")
        cancelled = threading.Event()

        async def add(request, response):
            if request.a < 0:
                try:
                    signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)
                    await asyncio.sleep(3600)
                finally:
                    cancelled.set()
            response.sum = request.a
            return response

        server = taskrpc.sync.Node("server", token="server").start()
        server.create_service(Add, "add", add)
        with taskrpc.sync.Node("client") as node:
            client = node.create_client(Add, "add")
            assert client.wait_for_service(60)
            connection = client._inner._channel._connection
            while connection._lent is None:
                client.call(Add.Request(a=1))
            try:
                client.call(Add.Request(a=-1), timeout=None)
            except KeyboardInterrupt:
                print("interrupted")
            assert cancelled.wait(60)
            print(client.call_async(Add.Request(a=2)).result(60).sum)
            print(client._inner._channel._connection is connection)
        server.close()
        """,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "interrupted\n2\nTrue\n", "")


def test_signal_handler_may_call_while_its_thread_reads(tmp_path):
    done = run(
        tmp_path,
        """
        import asyncio, signal, threading
        import srvgen, taskrpc.sync
        from taskrpc.core.transport.connection import threads

        threads.READ_TIMEOUT = 500
        Add = srvgen.load("example_interfaces/srv/AddTwoInts")

        async def add(request, response):
            if request.a < 0:
                signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)
                while not handled:
                    await asyncio.sleep(0.001)
            response.sum = request.a
            return response

        handled = []
        server = taskrpc.sync.Node("server", token="server").start()
        server.create_service(Add, "add", add, concurrency=2)
        with taskrpc.sync.Node("client") as node:
            client = node.create_client(Add, "add")
            assert client.wait_for_service(60)
            connection = client._inner._channel._connection

            def handle(*_):
                handled.append(client.call(Add.Request(a=3), timeout=60).sum)

            signal.signal(signal.SIGINT, handle)
            while connection._lent is None:
                client.call(Add.Request(a=1))
            print(client.call(Add.Request(a=-1), timeout=60).sum, handled)
        server.close()
        """,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "-1 [3]\n", "")


def run(folder, text):
    program = folder / "program.py"
    program.write_text(textwrap.dedent(text))
    command = [sys.executable, program]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
