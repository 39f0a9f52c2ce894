"""A thread sends a call and reads its response, with the same effects as the event loop."""

from __future__ import annotations

import asyncio
import socket
import time
from unittest import mock

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from taskrpc.core.transport.connection.client_side import OpenCall
from taskrpc.core.transport.connection.client_threads import (
    LEND_CHECK,
    ThreadedConnection,
    Waiter,
)
from taskrpc.core.transport.connection.connection import READ_BUFFER
from taskrpc.core.transport.connection.threads import ThreadSocket
from taskrpc.core.transport.limits.keepalive import DEFAULT
from taskrpc.core.wire.frames import LARGE
from taskrpc.core.wire.messages import Limits
from taskrpc.core.wire.session import LAST_CALL_ID, Session
from taskrpc.errors import InvalidRequest, ServerBusy, TaskRpcError
from taskrpc.testing import VirtualTimeLoop
from tests.core.wire.helpers import CLIENT, SERVER
from tests.properties import examples

NEARLY_ALL = LAST_CALL_ID - 2


class Owner:
    """The part of an endpoint that the connection needs."""

    keepalive = DEFAULT

    def __init__(self):
        self.loop = asyncio.get_running_loop()
        self.now = self.loop.time
        self.read_buffer = memoryview(bytearray(65_536))
        self.behind = []

    def connection_began(self, connection):
        """Nothing is counted here."""

    connection_ended = connection_began


class SocketTransport(asyncio.Transport):
    """Writes to a socket, or to a buffer while `is_full`; reads when the test says so."""

    def __init__(self, sock):
        super().__init__({"socket": sock})
        self.sock, self.buffer, self.is_full = sock, b"", False
        self.is_paused = self.is_closed = False

    def pause_reading(self):
        self.is_paused = True

    def resume_reading(self):
        self.is_paused = False

    def is_closing(self):
        return self.is_closed

    def close(self):
        self.is_closed = True

    def write(self, data):
        self.buffer += data
        if not self.is_full:
            self.empty()

    def empty(self):
        self.sock.sendall(self.buffer)
        self.buffer, self.is_full = b"", False

    def get_write_buffer_size(self):
        return len(self.buffer)


class End:
    """A connected client whose server answers when the test says so."""

    def __init__(self, limits):
        self.sock, self.peer = socket.socketpair()
        for each in (self.sock, self.peer):
            each.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 8 * LARGE)
            each.settimeout(60)
        self.transport = SocketTransport(self.sock)
        self.connection = ThreadedConnection(Owner(), CLIENT, lambda: None)
        self.server = Session(replace(SERVER, limits=limits), is_client=False)
        self.connection.connection_made(self.transport)
        self.connection._thread_socket._socket.setblocking(False)  # as asyncio's sockets are
        self.calls, self.stream = [], b""
        for _ in range(3):
            self.hear()
            self.answer()

    def hear(self):
        """Let the server read what was written; returns the bytes."""
        self.peer.setblocking(False)
        heard = b""
        try:
            while data := self.peer.recv(8 * LARGE):
                heard += data
        except BlockingIOError:
            pass
        self.stream += heard
        if heard:
            list(self.server.feed(heard))
        return heard

    def answer(self):
        """Let the client read the output of the server."""
        for piece in self.server.take():
            self.connection.get_buffer(-1)[: len(piece)] = piece
            self.connection.buffer_updated(len(piece))

    def read(self):
        """Let the event loop read what has arrived, unless it has stopped reading."""
        if self.transport.is_paused:
            return
        self.sock.setblocking(False)
        try:
            while count := self.sock.recv_into(self.connection.get_buffer(-1)):
                self.connection.buffer_updated(count)
        except BlockingIOError:
            pass

    def close(self):
        self.connection.connection_lost(None)
        self.sock.close()
        self.peer.close()

    def make(self, size, seconds):
        deadline = None if seconds is None else self.connection.owner.now() + seconds
        waiter = Waiter()
        body = bytes(size)
        call = waiter.call = OpenCall(waiter, self.connection, bytes, deadline, 1, body)
        self.calls.append(call)
        return call

    def call(self, size, seconds, *, in_thread):
        call = self.make(size, seconds)
        try:
            if not (in_thread and self.connection.begin_in_thread(call)):
                self.connection.begin(call)
        except InvalidRequest as error:
            call.future.set_exception(error)

    def do(self, step, *, in_thread):
        kind, *values = step
        connection = self.connection
        if kind == "call":
            self.call(*values, in_thread=in_thread)
        elif kind == "ping":
            connection.session.ping(7)
            connection.flush_soon()
        elif kind == "pause":
            connection.pause_writing()
        elif kind == "resume":
            connection.resume_writing()
        elif kind == "full":
            self.transport.is_full = True
            connection.session.ping(8)
            connection.flush()
        elif kind == "respond":
            self.transport.empty()
            self.hear()
            for call_id in list(self.server.open_calls)[:1]:
                self.server.respond(call_id, b"response")
            self.answer()
        else:
            connection.session.last_call_id = max(NEARLY_ALL, connection.session.last_call_id)

    def state(self):
        """Everything that a later call or the caller can see."""
        self.transport.empty()
        self.hear()
        connection, session = self.connection, self.connection.session
        return (
            self.stream,
            {number: (held[0].call_id, held[1]) for number, held in session.open_calls.items()},
            (session.bytes_in_flight, session.last_call_id, session.state),
            (
                connection.epoch,
                connection._writing_paused,
                len(connection._waiting),
                connection.check_before,
                connection.written,
                connection.received,
                self.transport.is_closed,
            ),
            [(call.call_id, call.is_late, outcome(call.future)) for call in self.calls],
        )


def outcome(waiter):
    """The result or error of the waiting thread, None while the call has not ended."""
    if not waiter.done():
        return None
    try:
        return waiter.wait()
    except TaskRpcError as error:
        return type(error), str(error), error.not_executed


sizes = st.one_of(
    st.integers(0, 30), st.sampled_from([100, 101, LARGE - 1, LARGE, 2 * LARGE, 2 * LARGE + 1])
)
a_call = st.tuples(st.just("call"), sizes, st.sampled_from([None, -1.0, 0.0, 0.003, 1.0, 50.0]))
other_step = st.sampled_from(
    [("ping",), ("pause",), ("resume",), ("full",), ("respond",), ("old",)]
)
steps = st.lists(st.tuples(st.one_of(a_call, a_call, other_step), st.booleans()), max_size=10)


@pytest.mark.real_time
@given(steps, st.sampled_from([100, 2 * LARGE]))
@settings(max_examples=examples(60), deadline=None)
def test_call_sent_by_a_thread_has_the_effects_of_one_sent_by_the_event_loop(steps, body):
    limits = Limits(body=body, calls=3, bytes=3 * LARGE)

    async def run():
        loop = asyncio.get_running_loop()
        ends = [End(limits), End(limits)]
        try:
            with mock.patch.object(time, "monotonic", loop.time):
                for step, turns in steps:
                    for end, in_thread in zip(ends, (True, False), strict=True):
                        end.do(step, in_thread=in_thread)
                    if turns:
                        await asyncio.sleep(0)
                await asyncio.sleep(0)
                await asyncio.sleep(0)
                fast, slow = (end.state() for end in ends)
                assert fast == slow
        finally:
            for end in ends:
                end.close()

    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        runner.run(run())


answers = st.lists(
    st.sampled_from(["response", "large", "error", "other", "ping", "services", "drain"]),
    min_size=1,
    max_size=4,
)


def answered(server, answers):
    """What the server sends to the call of a thread, and perhaps to a later one."""
    call, *others = sorted(server.open_calls)
    for answer in answers:
        match answer:
            case "response":
                server.respond(call, b"response")
            case "large":
                server.respond(call, bytes(READ_BUFFER + 1))
            case "error":
                server.fail(call, ServerBusy("later"))
            case "other" if others:
                server.respond(others[0], b"other response")
            case "ping":
                server.ping(7)
            case "services":
                server.advertise()
            case "drain":
                server.drain()
    return b"".join(server.take())


@pytest.mark.real_time
@given(
    answers,
    st.integers(0, 50),
    st.sampled_from(["nothing", "call", "retire"]),
    st.sampled_from([None, 0.025, 50.0]),
    st.sampled_from([1, 2]),
)
@example(["response", "ping"], 50, "nothing", None, 1)
@example(["response", "services"], 40, "nothing", None, 1)
@example(["response"], 50, "call", None, 1)
@example(["response"], 50, "retire", None, 1)
@settings(max_examples=examples(60), deadline=None)
def test_response_read_by_a_thread_has_the_effects_of_one_read_by_the_event_loop(
    answers, cut, step, seconds, calls
):
    """Some bytes arrive before the thread reads, and others later."""

    async def run():
        loop = asyncio.get_running_loop()
        ends = [End(Limits(calls=calls)), End(Limits(calls=calls))]
        fast, slow = ends
        done = []

        def meanwhile(end):
            if end not in done:
                done.append(end)
                if step == "call":
                    end.call(8, None, in_thread=False)
                elif step == "retire":
                    end.connection.retire()

        def wait(thread_socket):
            meanwhile(fast)
            really_wait(thread_socket)

        really_wait = ThreadSocket.wait
        try:
            with (
                mock.patch.object(time, "monotonic", loop.time),
                mock.patch.object(ThreadSocket, "wait", wait),
            ):
                fast.connection._lend()
                assert fast.transport.is_paused
                slow.connection.begin_in_thread(slow.make(8, seconds))
                meanwhile(slow)
                slow.hear()
                stream = answered(slow.server, answers)
                for end in ends:
                    end.peer.sendall(stream[:cut])
                fast.connection.call_in_thread(fast.make(8, seconds))
                meanwhile(fast)  # a thread with little time left does not wait
                for end in ends:
                    await asyncio.sleep(0)
                    end.read()
                if cut >= len(stream):
                    assert fast.state() == slow.state()
                for end in ends:
                    end.peer.sendall(stream[cut:])
                await asyncio.sleep(2 * LEND_CHECK)
                for end in ends:
                    end.read()
                await asyncio.sleep(0)
                assert fast.state() == slow.state()
                assert not fast.transport.is_paused
        finally:
            for end in ends:
                end.close()

    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        runner.run(run())
