"""The plain path of a server does the same as its general path, for every sequence of frames."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from asyncio import _enter_task, _leave_task
from unittest import mock

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

import srvgen
import taskrpc
from taskrpc.core.exactly_once import Deduplicator
from taskrpc.core.exactly_once.store_state import state_of
from taskrpc.core.request_ids.ids import RequestId, with_request_id
from taskrpc.core.request_ids.ledger import Ledger
from taskrpc.core.transport.codec import codec_of
from taskrpc.core.transport.connection import plain_serving
from taskrpc.core.transport.limits.quotas import FairQuota
from taskrpc.core.transport.memory import hub_of
from taskrpc.core.wire import messages
from taskrpc.core.wire.events import ResponseReceived
from taskrpc.core.wire.frames import LARGE, NO_DEADLINE, Flag, FrameType, pack_frame
from taskrpc.core.wire.handshake import Identity
from taskrpc.core.wire.messages import Limits, Resolve
from taskrpc.core.wire.session import LONGEST_TIME, Session
from taskrpc.errors import Code, HandlerError
from taskrpc.spi import Denied
from taskrpc.testing import VirtualTimeLoop
from tests.core.wire.helpers import Replaced
from tests.properties import examples

Add = srvgen.load("example_interfaces/srv/AddTwoInts")
Types = srvgen.load("rcl_interfaces/srv/GetParameterTypes")
LIMITS = Limits(body=200, calls=6, bytes=500)
NAMES = [codec_of(Types.Request).encode(Types.Request(names=["x"] * count)) for count in range(3)]
LONG = codec_of(Types.Request).encode(Types.Request(names=["x" * 180]))
REQUEST, OTHER = (codec_of(Add.Request).encode(Add.Request(a=20, b=b)) for b in (22, 23))


def facts():
    call = taskrpc.current_call()
    left = call.time_left()
    return call.number, call.service, call.caller, left and round(left, 6), call.cancelled


class Server:
    """A node with services of all kinds, and a client whose frames the test writes itself."""

    def __init__(self, node, token):
        self.loop = asyncio.get_running_loop()
        self.log = []
        self.node = node
        self.heard = b""
        self.tasks = []
        self.other = mock.Mock(loop=self.loop)
        kinds = (self.add, self.ask, self.hold, self.wait, self.task, self.none, self.wrong)
        kinds += (self.fail, self.refuse, self.deny, self.pause, self.withdraw)
        kinds += (self.hog, self.stop, self.close, self.drain)
        kinds += (self.later_add, self.later_ask, self.later_none, self.later_fail, self.later_hog)
        kinds += (self.forgets_await,)
        self.services = [node.create_service(Add, kind.__name__, kind) for kind in kinds]
        node.create_service(Add, "three", self.wait, concurrency=3)
        node.create_service(Types, "large", self.large)
        node.create_service(Types, "texts", self.texts, concurrency=9)
        self.store = taskrpc.MemoryCompletions()
        once = {
            "once": self.add,
            "once_ask": self.ask,
            "once_later": self.later_add,
            "once_wait": self.wait,
            "once_none": self.none,
            "once_fail": self.fail,
            "once_refuse": self.refuse,
            "once_undone": self.undone,
            "once_task": self.task,
            "once_effect": self.effect,
        }
        for name, callback in once.items():
            self.services.append(
                node.create_service(Add, name, callback, exactly_once=self.store, concurrency=2)
            )
        self.names = [*(kind.__name__ for kind in kinds), "three", "large", "texts", *once]
        self.transport = Transport(self)
        (listener,) = hub_of(0).listeners.values()
        self.end = listener.factory()
        self.end.session.limits = LIMITS
        self.end.session.set_quota(3, 100)
        self.end.connection_made(self.transport)
        self.session = Session(Identity(b"C" * 16, b"c" * 16, token), is_client=True)
        self.methods = {}
        self.has_asked = False

    async def begin(self):
        """Shake hands, and look up all services."""
        while len(self.methods) < len(self.names):
            self.read(b"".join(self.session.take()))
            self.hear()
            await asyncio.sleep(0)  # the store of the exactly-once services opens

    def hear(self):
        """Take the answers of the handshake and of the lookups."""
        heard, self.heard = self.heard, b""
        events = list(self.session.feed(heard))
        if self.session.state.value == "open" and not self.has_asked:
            self.has_asked = True
            for name in self.names:
                self.session.resolve(name, Resolve(f"/{name}"))
        for each in events:
            if isinstance(each, ResponseReceived):
                self.methods[each.ticket] = messages.decode_resolved(each.body).method

    def read(self, data):
        """Let the server read these bytes at once."""
        while data and not self.transport.is_closing():
            room = self.end.get_buffer(-1)
            count = min(len(data), len(room))
            room[:count] = data[:count]
            self.end.buffer_updated(count)
            data = data[count:]

    def given(self, data):
        """Let the server read these bytes as the event loop does: in no task."""
        task = asyncio.current_task()
        _leave_task(self.loop, task)
        try:
            self.read(data)
        finally:
            _enter_task(self.loop, task)

    def unread(self, size):
        """Let another caller leave so many bytes of responses unread."""
        self.other.transport.get_write_buffer_size.return_value = size
        self.other.written = size
        if size:
            self.end.backpressure.answered("/large", self.other, size)
        self.end.backpressure.measure(self.other)

    def lend(self, calls):
        """Let the caller have only so many calls in flight beside those that are free."""
        self.end.server.calls_in_flight._calls = FairQuota(2 * calls)

    # The callbacks

    def add(self, request, response):
        self.log.append(("add", request.a, request.b))
        response.sum = request.a + request.b
        return response

    def ask(self, request, response):
        self.log.append(("ask", facts()))
        logging.getLogger("callback").info("asked")
        return self.add(request, response)

    def hold(self, request, response):
        self.loop.advance(0.02)
        return self.add(request, response)

    def hog(self, request, response):
        self.loop.advance(0.3)
        return self.add(request, response)

    def stop(self, request, response):
        self.loop.advance(LONGEST_TIME / 1e6 + 1)
        return self.add(request, response)

    def close(self, request, response):
        self.end.close()
        return self.add(request, response)

    def drain(self, request, response):
        self.end.drain()
        return self.add(request, response)

    async def wait(self, request, response):
        self.log.append(("waits", facts()))
        try:
            await asyncio.sleep(0.01)
        except asyncio.CancelledError:
            self.log.append(("cancelled", facts()))
            raise
        return self.add(request, response)

    async def later_add(self, request, response):
        return self.add(request, response)

    async def later_ask(self, request, response):
        return self.ask(request, response)

    async def later_none(self, request, response):
        self.add(request, response)

    async def later_fail(self, request, response):
        raise ValueError("a mistake")

    async def later_hog(self, request, response):
        return self.hog(request, response)

    async def forgets_await(self, request, response):
        found = asyncio.Future()
        found.set_result(self.add(request, response))
        return found

    def undone(self, request, response):
        taskrpc.current_call().nothing_done()
        return self.add(request, response)

    def effect(self, request, response):
        return taskrpc.Effect(self.add(request, response), lambda: self.log.append("an effect"))

    async def texts(self, request, response):
        await asyncio.sleep(0.01)
        return response

    def task(self, request, response):
        async def later():
            await asyncio.sleep(0)
            self.log.append(("later", facts()))

        self.tasks.append(self.loop.create_task(later()))
        return self.add(request, response)

    def none(self, request, response):
        self.add(request, response)

    def wrong(self, request, response):
        response.sum = 2**70
        return response

    def fail(self, request, response):
        raise ValueError("a mistake")

    def refuse(self, request, response):
        raise HandlerError(Code.UNAVAILABLE, "not now")

    def deny(self, request, response):
        raise Denied("not you")

    def pause(self, request, response):
        self.transport.grow(LARGE)
        return self.add(request, response)

    def large(self, request, response):
        response.types = bytes(LARGE - 4 + len(request.names))
        return response

    def withdraw(self, request, response):
        for service in self.services:
            if service.service_name in ("/add", "/ask", "/withdraw"):
                service.destroy()
        return self.add(request, response)


class Transport(asyncio.Transport):
    """Keeps what the server writes."""

    def __init__(self, server):
        super().__init__({"peername": ("192.0.2.1", 1)})
        self._server = server
        self._unread = 0
        self._closing = False

    def write(self, data):
        self._server.heard += bytes(data)

    def grow(self, size):
        """Let the caller leave so many bytes unread."""
        self._unread += size
        self._server.end.pause_writing()

    def read_all(self):
        self._unread = 0
        self._server.end.resume_writing()

    def get_write_buffer_size(self):
        return self._unread

    def pause_reading(self):
        pass

    def resume_reading(self):
        pass

    def is_closing(self):
        return self._closing

    def close(self):
        self._closing = True
        self._server.loop.call_soon(self._server.end.connection_lost, None)

    abort = close


def mostly(usual, *others):
    """Mostly the usual value."""
    return st.sampled_from([*[usual] * (9 + 3 * len(others)), *others])


names = st.sampled_from(
    "add add add ask hold wait wait three three task none wrong fail refuse deny pause large large"
    " withdraw missing hog close drain later_add later_add later_ask later_none later_fail"
    " later_hog forgets_await".split()
)
a_call = st.tuples(
    st.just("call"),
    names,
    mostly(None, b"", b"\x92\x01", b"\x91\x01", REQUEST + b"x", *NAMES),
    st.sampled_from([NO_DEADLINE, NO_DEADLINE, 10_000, 10_000, 5, 1, 0]),
    mostly(0, int(Flag.TRACED), int(Flag.EXACTLY_ONCE), 64),
    mostly(1, 3, 1, 1, 1, 1, 1, 0),
)
once_names = st.sampled_from(
    "once once once once_ask once_later once_wait once_none once_fail once_refuse once_undone"
    " once_task once_effect".split()
)
a_call_with_id = st.tuples(
    st.just("once"),
    once_names,
    st.sampled_from([NO_DEADLINE, NO_DEADLINE, 10_000, 5, 0]),
    st.sampled_from([b"c" * 16, b"c" * 16, b"d" * 16]),
    st.integers(1, 4),
    mostly(1, 2, 0),
    mostly(REQUEST, OTHER, b""),
)
a_step = st.one_of(
    a_call,
    a_call,
    a_call,
    a_call_with_id,
    a_call_with_id,
    st.tuples(st.just("cancel"), st.integers(0, 5)),
    st.sampled_from([("ping",), ("pause",), ("resume",), ("observe",), ("full",), ("room",)]),
    # No sum of these times is 0.01: asyncio does not order timers of the same time.
    st.tuples(st.just("time"), st.sampled_from([0.0, 0.004, 0.0103, 0.3])),
)
cuts = st.lists(st.integers(1, 90), max_size=4)
"""The sizes of the first reads; the rest comes in one."""
a_batch = st.tuples(st.lists(a_step, min_size=1, max_size=8), cuts)
batches = st.lists(a_batch, min_size=1, max_size=4)


class Observing(taskrpc.Observer):
    def __init__(self, log):
        self._log = log

    def call_began(self, call):
        self._log.append(("began", call.service, call.number))

    def call_ended(self, call, code: Code, seconds: float):
        self._log.append(("ended", call.service, call.number, code, round(seconds, 6)))


async def played(batches):
    """Play the steps; return everything that the caller and the callbacks saw."""
    async with taskrpc.Node("server", transport="memory", token="t" * 32) as node:
        server = Server(node, b"t" * 32)
        await server.begin()
        server.heard = b""
        records = Records(server.log)
        last, sent = server.session.last_call_id, []
        for steps, sizes in batches:
            data = b""
            for kind, *values in steps:
                if kind == "call":
                    name, body, left, bits, step = values
                    if body is None:
                        body = NAMES[last % 3] if name == "large" else REQUEST
                    if bits == Flag.TRACED:
                        body = bytes(25) + body
                    last += step
                    sent.append(last)
                    method = server.methods.get(name, 99)
                    data += pack_frame(FrameType.REQUEST, bits, method, last, left, body)
                elif kind == "once":
                    name, left, client, sequence, first, body = values
                    body = with_request_id(RequestId(client, sequence, first), body)
                    last += 1
                    sent.append(last)
                    bits, method = int(Flag.EXACTLY_ONCE), server.methods[name]
                    data += pack_frame(FrameType.REQUEST, bits, method, last, left, body)
                elif kind == "cancel":
                    known = sent[values[0]] if values[0] < len(sent) else 77
                    data += pack_frame(FrameType.CANCEL, 0, 0, known, 0)
                elif kind == "ping":
                    data += pack_frame(FrameType.PING, 0, 0, 0, 5)
                else:
                    server.given(data)
                    data = b""
                    if kind == "pause":
                        server.transport.grow(10)
                    elif kind == "resume":
                        server.transport.read_all()
                    elif kind in ("full", "room"):
                        server.unread(40_000_000 if kind == "full" else 0)
                    elif kind == "observe":
                        server.services[0].observe(Observing(server.log))
                    elif kind == "lend":
                        server.lend(values[0])
                    else:
                        await asyncio.sleep(values[0])
            for size in sizes:
                server.given(data[:size])
                data = data[size:]
            server.given(data)
            server.log.append(("written", server.heard))
        server.transport.read_all()
        await asyncio.sleep(1)
        records.close()
        statuses = [(each.name, each.running, each.waiting) for each in node.status().services]
        state_of_store = (
            server.store._index.all(),
            [each.once for each in node.status().services],
            state_of(server.store).next_expiry,
            [
                (client, record.used, record.placed, record.first_incomplete, list(record.requests))
                for client, record in state_of(server.store).ledger._clients.items()
            ],
        )
        end = server.end.session
        state = end.state, end.last_call_id, end.bytes_in_flight, len(end.open_calls)
        state += tuple(each.finished.done() for each in server.services)
        state += tuple(sorted(server.end.backpressure._large))
    return server.heard, server.log, statuses, state, state_of_store


class Records(logging.Handler):
    """Adds what is logged, and the number of the call that it is about."""

    def __init__(self, log):
        super().__init__()
        self._log = log
        self.addFilter(taskrpc.logs.CallFilter())
        logging.getLogger().addHandler(self)

    def emit(self, record: logging.LogRecord):
        self._log.append((record.getMessage(), getattr(record, "call", None)))

    def close(self):
        logging.getLogger().removeHandler(self)
        super().close()


def outcome(batches, *, plain):
    with contextlib.ExitStack() as stack:
        if not plain:  # leave every frame to the events
            stack.enter_context(mock.patch.object(Session, "serve", lambda *given: given[1::3]))
        runner = stack.enter_context(asyncio.Runner(loop_factory=lambda: VirtualTimeLoop(seed=1)))
        return runner.run(played(batches))


class Different(Exception):
    """The paths have different results."""


def assert_same(batches):
    try:
        found = outcome(batches, plain=True)
    except Exception as error:
        raise Different("the plain path fails") from error
    expected = outcome(batches, plain=False)
    differences = [pair for pair in zip(expected, found, strict=True) if pair[0] != pair[1]]
    if differences:
        raise Different(f"expected and got: {differences}")


@given(batches)
@settings(max_examples=examples(300), deadline=None)
def test_plain_path_has_the_results_of_the_general_path(batches):
    assert_same(batches)


def call(name, left=NO_DEADLINE, bits=0, step=1, body=None):
    return "call", name, body, left, bits, step


def once(name, sequence, first=1, left=NO_DEADLINE, body=REQUEST, client=b"c" * 16):
    return "once", name, left, client, sequence, first, body


FIRST = once("once", 1)
SCENARIOS = [
    # An earlier callback of the same read took so long that the deadline has passed.
    [([call("hold"), call("add", 5), call("add", 40)], [])],
    [([call("hog"), call("add")], [])],
    # A call arrives while the next of those that wait is about to start.
    *(
        [([call("wait"), call("wait"), ("time", 0.01), *[("time", 0.0)] * turns, call("wait")], [])]
        for turns in range(5)
    ),
    # Responses wait for callers that do not read.
    [([call("large")], []), ([("full",), call("large"), call("add"), ("room",)], [])],
    [([call("pause"), call("add"), ("resume",)], [])],
    # The callback withdraws services, closes the connection or drains it.
    [([call("withdraw"), call("add"), call("ask"), call("withdraw")], [])],
    [([call("close"), call("add")], [])],
    [([call("drain"), call("add")], [])],
    # Limits: three calls and a hundred bytes are free, six calls and 500 bytes the limit.
    [([call("three")] * 9, [])],
    [([call("wait", body=bytes(150)), call("wait"), call("wait", body=bytes(199))], [])],
    [([call("add", body=bytes(201)), call("add")], [])],
    # The server lends the caller one call more, or none.
    *(
        [([("lend", lent), *[call("three")] * calls, *[call("add")] * 2], [])]
        for lent in (0, 1)
        for calls in (2, 3, 4)
    ),
    # The callback takes longer than the server time of a response can say.
    [([call("stop"), call("add")], [])],
    [([call("texts", body=LONG)] * 4, [])],
    # What a callback began goes on when the next call is served.
    [([call("task"), call("task"), call("add"), ("time", 0.0)], [])],
    [([call("ask"), call("add"), ("cancel", 0), call("ask", 7)], [30, 5])],
    [([call("wait", 5), ("cancel", 0), call("add", 0)], [])],
    [([call("wait"), ("cancel", 0), ("time", 0.3)], [])],
    [([call("add"), call("add", step=0), call("add")], [])],
    # Requests with ids, of which the first looks for leases that have ended: repeated, settled,
    # changed, refused, stale, and without an id.
    *(
        [([FIRST, once(name, 2), once(name, 2), once(name, 3, 3), once(name, 2)], [])]
        for name in ("once", "once_ask", "once_later", "once_fail", "once_undone", "once_effect")
    ),
    [([FIRST, once("once", 1, body=OTHER), once("once", 2, 0), once("once", 4, 3)], [])],
    [
        (
            [
                FIRST,
                once("once", 2, left=0),
                once("once", 2),
                once("once_wait", 3),
                once("once", 3),
            ],
            [],
        )
    ],
    [([FIRST, once("once_task", 2), once("once", 3), ("time", 0.0)], [])],
    # It is time to look for ended leases again, and the client is active.
    [
        ([FIRST, ("time", 40.0), once("once", 1, client=b"d" * 16)], []),
        ([("time", 30.0), once("once", 2, client=b"d" * 16)], []),
    ],
    [([FIRST, once("once_wait", 2, left=5), ("time", 0.3), once("once_wait", 2)], [])],
    [([FIRST, once("once_wait", 2), ("cancel", 1), ("time", 0.3), once("once", 2)], [])],
    [([FIRST, call("once"), once("once", 2), call("once"), once("once_ask", 3)], [])],
    [([call("add", bits=int(Flag.TRACED)), call("add", bits=int(Flag.EXACTLY_ONCE))], [])],
]
"""Rare coincidences; the random sequences have the rest."""


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_plain_path_has_the_results_of_the_general_path_in_rare_cases(scenario):
    assert_same(scenario)


PLAIN = [
    ("flags == flags_of_route", "True"),
    ("once.complete(completion, record)", "pass"),
    ("arrived + clock.offset", "arrived"),
    ("(at := arrived + clock.offset) < state.next_expiry", "(at := arrived + clock.offset)"),
    ("if record is None:", "if False:"),
    ("service.running < service.concurrency", "True"),
    ("not waiting.count", "True"),
    ("and method in offers", "and True"),
    ("not connection.writing_paused", "True"),
    ("not backpressure.is_active", "True"),
    ("arrived + time_left / 1000 > began", "True"),
    ("arrived + time_left / 1000 > began", "arrived + time_left / 1000 >= began"),
    ("service.running += 1", "pass"),
    ("service.running -= 1", "pass"),
    ("number = numbers.last + 1", "number = numbers.last"),
    (" and call.call is None", ""),
    ("(length := len(encoded)) > limit", "(length := len(encoded)) < 0"),
    ("error, service.raised", "error, service.returned"),
    ("go_on(call.made()", "service.returned(call.made()"),
    ("reset_answering(token)", "pass"),
    ("call.ended = True", "pass"),
    ("connection.clock_at = ended = now()", "ended = now()"),
    ("service.held(ended - began)", "pass"),
    ("service.finished(began)", "pass"),
    ("ended - arrived", "ended - began"),
]
SERVING = [
    ("and self.state is _OPEN:", ":"),
    ("end - body > splitter.limit", "False"),
    ("call_id <= self.last_call_id", "False"),
    ("len(open_calls) >= self.free_calls", "False"),
    ("len(open_calls) >= self.free_calls", "len(open_calls) > self.free_calls"),
    ("self.bytes_in_flight + end - body > self.free_bytes", "False"),
    ("self.last_call_id = call_id", "pass"),
    ("data = splitter.take_tail() + data", "splitter.take_tail()"),
    ("self.state is not _CLOSED", "True"),
    ("server_time = LONGEST_TIME", "pass"),
]
DIFFERENCES = [
    *((plain_serving, "_plain", *texts) for texts in PLAIN),
    *((Session, "serve", *texts) for texts in SERVING),
    (Deduplicator, "complete", "self._new += 1", "pass"),
    (Deduplicator, "executed", "self._new += 1", "pass"),
    (Deduplicator, "complete", "self._store.complete(completion, None)", "pass"),
    (Deduplicator, "complete", "more := record.enter(completion)", "record.enter(completion)"),
    (Deduplicator, "complete", "more := record.enter(completion)", "more := 0"),
    (Deduplicator, "executed", "execution.started = True", "pass"),
    (Deduplicator, "executed", "ledger.add_running(call.principal, call.received_id, now)", "pass"),
    (Ledger, "admit", "first_incomplete < record.first_incomplete", "False"),
    (Ledger, "admit", "sequence in (requests := record.requests)", "(requests := None)"),
    (Ledger, "admit", "record.used = now", "pass"),
    (Session, "accept", "self.bytes_in_flight += size", "pass"),
]


@pytest.mark.faults
@pytest.mark.parametrize(("owner", "name", "text", "by"), DIFFERENCES)
def test_a_difference_between_the_paths_is_found(owner, name, text, by):
    @given(batches)
    @settings(max_examples=200, database=None, derandomize=True, phases=[Phase.generate])
    def compare(batches):
        assert_same(batches)

    def compare_all():
        for scenario in SCENARIOS:
            assert_same(scenario)
        compare()

    with Replaced(owner, name, text, by).patch, pytest.raises(Different):
        compare_all()
