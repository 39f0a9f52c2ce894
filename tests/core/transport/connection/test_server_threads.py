"""Threads send responses themselves: at once, complete, and counted by the event loop."""

import asyncio
import contextlib
import errno
import random
import socket
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

import srvgen
import taskrpc
import taskrpc.sync
from taskrpc.core.transport.connection.server_threads import ThreadedServing
from taskrpc.core.wire.frames import LARGE

pytestmark = pytest.mark.real_time

Echo = srvgen.load("turtlesim/srv/Spawn")


@pytest.fixture
def server():
    with taskrpc.sync.Node("server") as server:
        yield server


@pytest.fixture
def taken(server):
    """The calls, in the order in which they arrive."""
    taken = []
    server.create_deferred_service(Echo, "echo", taken.append)
    return taken


@pytest.fixture
async def client(taken):
    async with taskrpc.Node("caller") as node:
        client = node.create_client(Echo, "echo", timeout=20)
        assert await client.wait_for_service(60)
        yield client


def served(server):
    """The server's only connection."""
    (connection,) = server._node._transport._served
    return connection


async def calls(client, taken, count):
    futures = [client.call_async(Echo.Request(name=str(number))) for number in range(count)]
    while len(taken) < count:
        await asyncio.sleep(0.001)
    return futures


def answer_here(call, text):
    """Respond from this thread; returns False where that is impossible."""
    body = call._service.encode(Echo.Response(name=text))
    if not call._call.reply_in_thread(body):
        return False
    call._service.done(call._call)
    return True


@contextlib.asynccontextmanager
async def standing(server):
    """Block the server's event loop."""
    release, busy = threading.Event(), threading.Event()
    server._loop.soon(lambda: (busy.set(), release.wait(300)))
    await asyncio.to_thread(busy.wait)
    try:
        yield
    finally:
        release.set()


async def test_response_is_sent_while_the_servers_loop_is_busy(server, client, taken):
    (future,) = await calls(client, taken, 1)
    async with standing(server):
        await asyncio.to_thread(taken[0].reply, Echo.Response(name="at once"))
        assert (await asyncio.wait_for(future, 60)).name == "at once"


@pytest.mark.parametrize("answers", [1, 3])
async def test_response_does_not_overtake_earlier_output(server, taken, answers):
    got = []
    async with taskrpc.Node("caller") as node:
        client = node.create_client(Echo, "echo")
        node.create_subscription(Echo.Request, "news", got.append)
        publisher = server.create_publisher(Echo.Request, "news")
        assert await client.wait_for_service(60)
        while not publisher.get_subscription_count():
            await asyncio.sleep(0.01)
        for future in await calls(client, taken, answers):
            future.add_done_callback(lambda done: got.append(done.result()))
        async with standing(server):
            publisher.publish(Echo.Request(name="0"))
            for number, call in enumerate(taken, 1):
                call.reply(Echo.Response(name=str(number)))
            await asyncio.sleep(0.05)
            assert got == []
        while len(got) <= answers:
            await asyncio.sleep(0.001)
        assert [each.name for each in got] == [str(number) for number in range(answers + 1)]


async def test_only_the_first_response_is_sent(client, taken):
    (future,) = await calls(client, taken, 1)
    for text in ("first", "second"):
        taken[0].reply(Echo.Response(name=text))
    taken[0].fail(taskrpc.ServerBusy("late"))
    assert (await future).name == "first"


async def test_event_loop_sends_large_responses(client, taken):
    (future,) = await calls(client, taken, 1)
    assert not answer_here(taken[0], "x" * LARGE)
    taken[0].reply(Echo.Response(name="x" * LARGE))
    assert len((await future).name) == LARGE


async def test_caller_that_does_not_read_gets_every_response_complete(server, client, taken):
    futures = await calls(client, taken, 60)
    sock = served(server).transport.get_extra_info("socket")
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
    texts = [f"{number:05}" * (LARGE // 6) for number in range(60)]
    here = 0
    for call, text in zip(taken, texts, strict=True):  # this thread's loop, the caller's, stands
        if answer_here(call, text):
            here += 1
        else:
            call.reply(Echo.Response(name=text))
    assert 0 < here < 60
    assert [answer.name for answer in await asyncio.gather(*futures)] == texts
    assert served(server)._thread_socket.is_whole


async def test_response_that_a_thread_began_is_completed_before_the_connection_closes(
    server, client, taken
):
    futures = await calls(client, taken, 60)
    connection = served(server)
    sock = connection.transport.get_extra_info("socket")
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
    text = "x" * (LARGE - 1000)
    closed = threading.Event()

    def answer_and_close():  # in the loop's thread, so that it has no turn between
        count = 0
        while answer_here(taken[count], text):
            count += 1
            if not connection._thread_socket.is_whole:
                break
        connection.close()
        closed.count = count
        closed.set()

    server._loop.soon(answer_and_close)
    closed.wait(5)  # this thread's loop, the caller's, stands
    done, _ = await asyncio.wait(futures[: closed.count], timeout=5)
    assert 0 < len(done) == closed.count < 60
    assert all(future.result().name == text for future in done)


class Full:
    """A socket whose system has no buffer space."""

    def __init__(self, sock):
        self._sock = sock
        self.close = sock.close

    def send(self, data):
        raise OSError(errno.ENOBUFS, "no room")


async def test_event_loop_sends_a_response_that_the_system_did_not_accept(server, client, taken):
    (future,) = await calls(client, taken, 1)
    here = served(server)._thread_socket
    here.open(served(server).transport)
    here._socket = Full(here._socket)
    served(server)._open_tried = True
    assert answer_here(taken[0], "x")
    assert (await asyncio.wait_for(future, 60)).name == "x"


class Exhausted:
    """A transport of a program that has reached its limit of open files."""

    def get_extra_info(self, name):
        return self if name == "socket" else None

    def dup(self):
        raise OSError(errno.EMFILE, "too many open files")


async def test_event_loop_responds_without_a_descriptor_for_threads(server, client, taken):
    (future,) = await calls(client, taken, 1)
    here = served(server)._thread_socket
    here.open(Exhausted())
    served(server)._open_tried = True
    assert not answer_here(taken[0], "x")
    taken[0].reply(Echo.Response(name="x"))
    assert (await asyncio.wait_for(future, 60)).name == "x"


async def test_threads_and_the_loop_may_respond_at_the_same_time(server, client, taken):
    chance = random.Random(1)

    def answer(call):
        while chance.random() < 0.2:
            time.sleep(0.0001)
        text = call.request.name * chance.choice([1, 1, 1, 1000, 20_000])
        if not answer_here(call, text):
            call.reply(Echo.Response(name=text))

    with ThreadPoolExecutor(4) as threads:
        for _ in range(20):
            taken.clear()
            futures = await calls(client, taken, 20)
            for call in taken:
                threads.submit(answer, call)
            answers = await asyncio.wait_for(asyncio.gather(*futures), 20)
            assert all(each.name.startswith(str(n)) for n, each in enumerate(answers))
    connection = served(server)
    connection.owner.loop.call_soon_threadsafe(connection._settle)
    while connection._freed:
        await asyncio.sleep(0.001)
    assert connection.session.in_flight == connection.session.bytes_in_flight == 0


async def test_drain_waits_for_responses_of_threads(client, taken, server):
    (future,) = await calls(client, taken, 1)
    ending = asyncio.create_task(
        asyncio.to_thread(lambda: server._loop.run(server._node.drain(), "drain()"))
    )
    await asyncio.sleep(0.05)
    taken[0].reply(Echo.Response(name="the last one"))
    assert (await future).name == "the last one"
    await asyncio.wait_for(ending, 60)


async def test_response_to_a_lost_caller_is_dropped(server, taken):
    async with taskrpc.Node("caller") as node:
        client = node.create_client(Echo, "echo")
        assert await client.wait_for_service(60)
        await calls(client, taken, 1)
        connection = served(server)
        assert isinstance(connection, ThreadedServing)
        answered = answer_here(taken[0], "x")
        assert answered
        await calls(client, taken, 2)
    while connection.transport is not None:
        await asyncio.sleep(0.01)
    assert not connection._thread_socket.is_open
    for call in taken:
        call.reply(Echo.Response())
    assert not answer_here(taken[-1], "late")
