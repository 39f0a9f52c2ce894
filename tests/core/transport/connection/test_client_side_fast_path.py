"""A client sends a small request at once, with the same effects as through its queue."""

from __future__ import annotations

import asyncio
import struct

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from taskrpc.core.transport.connection.client_side import (
    CallingConnection,
    OpenCall,
    time_left,
)
from taskrpc.core.transport.limits.keepalive import DEFAULT
from taskrpc.core.wire.frames import LARGE
from taskrpc.core.wire.messages import Limits
from taskrpc.core.wire.session import LAST_CALL_ID, Session
from taskrpc.errors import InvalidRequest, TaskRpcError
from taskrpc.testing import VirtualTimeLoop
from tests.core.wire.helpers import CLIENT, SERVER, Replaced
from tests.properties import examples


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


class Transport(asyncio.Transport):
    """Keeps what was written."""

    def __init__(self):
        super().__init__()
        self.written = b""

    def write(self, data):
        self.written += data

    def get_write_buffer_size(self):
        return 0


class General(CallingConnection):
    """Sends each call as it sends the calls that waited."""

    def begin(self, call, left=0):
        limit, deadline = self.session.body_limit, call.deadline
        if len(call.body) > limit:
            size = len(call.body)
            raise InvalidRequest("", f"a message of {size} bytes; the server accepts {limit}")
        if deadline is not None and deadline < self.check_before:
            self.watch(deadline)
        if self._waiting or self._writing_paused or not self._send(call):
            self._waiting.append(call)


class End:
    """A connected client whose server answers when the test says so."""

    def __init__(self, kind, limits):
        self.transport = Transport()
        self.connection = kind(Owner(), CLIENT)
        self.server = Session(replace(SERVER, limits=limits), is_client=False)
        self.connection.connection_made(self.transport)
        self.calls, self.stream = [], b""
        for _ in range(3):
            self.hear()
            self.answer()

    def hear(self):
        """Let the server read what was written."""
        heard, self.transport.written = self.transport.written, b""
        self.stream += heard
        for start in range(0, len(heard), 50_000):
            list(self.server.feed(heard[start : start + 50_000]))

    def answer(self):
        """Let the client read the output of the server in one read."""
        data = b"".join(self.server.take())
        self.connection.get_buffer(-1)[: len(data)] = data
        if data:
            self.connection.buffer_updated(len(data))

    def call(self, size, seconds, knows_left):
        loop = asyncio.get_running_loop()
        deadline = None if seconds is None else loop.time() + seconds
        left = time_left(seconds, 0.0) if knows_left and seconds is not None else 0
        call = OpenCall(loop.create_future(), self.connection, bytes, deadline, 1, bytes(size))
        call.future.add_done_callback(lambda each: each.cancelled() or each.exception())
        self.calls.append(call)
        try:
            self.connection.begin(call, left)
        except InvalidRequest as error:
            call.future.set_exception(error)

    def do(self, step):
        kind, *values = step
        connection = self.connection
        if kind == "call":
            self.call(*values)
        elif kind == "ping":
            connection.session.ping(7)
        elif kind == "pause":
            connection.pause_writing()
        elif kind == "resume":
            connection.resume_writing()
        elif kind == "in turn":
            connection.in_turn = not connection.in_turn
        elif kind == "cancel":
            for call in self.calls[-1:]:
                call.future.cancel()
                call.cancel()
        elif kind == "respond":
            self.hear()
            for call_id in list(self.server.open_calls)[:2]:
                self.server.respond(call_id, b"response")
            self.answer()
        elif kind == "lose":
            connection.connection_lost(None)
        else:
            connection.session.last_call_id = max(LAST_CALL_ID - 2, connection.session.last_call_id)

    def state(self):
        """Everything that the server, a later call or the caller can see."""
        connection, session = self.connection, self.connection.session
        return (
            self.stream + self.transport.written,
            {number: (held[0] is None, held[1]) for number, held in session.open_calls.items()},
            (session.bytes_in_flight, session.last_call_id, session.state, session.out),
            (
                connection.epoch,
                connection._writing_paused,
                len(connection._waiting),
                connection.check_before,
                connection.written,
            ),
            [(call.call_id, call.is_late, outcome(call.future)) for call in self.calls],
        )


def outcome(future):
    if not future.done() or future.cancelled():
        return future.done()
    error = future.exception()
    return future.result() if error is None else (type(error), str(error), error.not_executed)


sizes = st.one_of(
    st.integers(0, 30), st.sampled_from([100, 101, LARGE - 1, LARGE, 2 * LARGE, 2 * LARGE + 1])
)
times = st.sampled_from([None, -1.0, 0.0, 0.003, 0.1, 1.0, 10.0, 50.0])
a_call = st.tuples(st.just("call"), sizes, times, st.booleans())
other_step = st.sampled_from(
    [(each,) for each in "ping pause resume respond respond cancel lose old".split()]
    + [("in turn",), ("time", 0.0), ("time", 0.0), ("time", 0.07)]
)
steps = st.lists(st.one_of(a_call, a_call, other_step), max_size=10)


async def compare(steps, body):
    limits = Limits(body=body, calls=3, bytes=3 * LARGE)
    ends = [End(CallingConnection, limits), End(General, limits)]
    for step in steps:
        if step[0] == "time":
            await asyncio.sleep(step[1])
        else:
            for end in ends:
                end.do(step)
        plain, general = (end.state() for end in ends)
        if plain != general:
            raise Different(f"after {step}: expected {general}, got {plain}")


class Different(Exception):
    """The paths have different effects."""


def run(steps, body):
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        runner.run(compare(steps, body))


@given(steps, st.sampled_from([100, 2 * LARGE]))
@settings(max_examples=examples(200), deadline=None)
def test_call_sent_at_once_has_the_effects_of_one_sent_from_the_queue(steps, body):
    run(steps, body)


@pytest.mark.faults
@pytest.mark.parametrize(
    ("name", "text", "by"),
    [
        ("begin", "size > session.body_limit", "False"),
        ("begin", "deadline < self.check_before", "False"),
        ("begin", "if not left:", "if True:\n            left = 1\n        if False:"),
        ("begin", "self._waiting or self._writing_paused", "self._waiting"),
        ("begin", "self._waiting or self._writing_paused", "self._writing_paused"),
        ("begin", "left <= 0 or ", ""),
        ("begin", " or size >= LARGE", ""),
        ("begin", "is_first = not session.open_calls", "is_first = True"),
        ("begin", "session.out or self.in_turn", "self.in_turn"),
        ("begin", "session.out or self.in_turn", "session.out"),
        ("begin", "call_id >= LAST_CALL_ID", "False"),
        ("begin", "self._watch.written += HEADER.size + size", "pass"),
    ],
)
def test_a_difference_between_the_ways_to_send_is_found(name, text, by):
    @given(steps, st.sampled_from([100, 2 * LARGE]))
    @settings(max_examples=2000, database=None, derandomize=True, phases=[Phase.generate])
    def find(steps, body):
        try:
            run(steps, body)
        except (TaskRpcError, struct.error) as error:  # the difference itself fails
            raise Different from error

    with Replaced(CallingConnection, name, text, by).patch, pytest.raises(Different):
        find()
