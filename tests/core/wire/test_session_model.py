"""Compares a client and a server with a model, for random orders of events."""

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    Bundle,
    RuleBasedStateMachine,
    initialize,
    invariant,
    multiple,
    precondition,
    rule,
)

from taskrpc.core.wire.connection_state import ConnectionState
from taskrpc.core.wire.events import (
    CancelReceived,
    Draining,
    ErrorReceived,
    LargeRequestBegan,
    QuotaExceeded,
    RequestReceived,
    ResolveReceived,
    ResponseReceived,
)
from taskrpc.core.wire.frames import LARGE
from taskrpc.core.wire.messages import Limits, Resolve, encode
from taskrpc.errors import TaskRpcError
from tests.core.wire.helpers import open_pair
from tests.properties import examples

LIMITS = Limits(body=3 * LARGE, calls=3, bytes=100)
QUESTION = len(encode(Resolve("/x")))
sizes = st.one_of(st.integers(0, 60), st.integers(0, 60), st.integers(LARGE - 1, 3 * LARGE))
counts = st.one_of(st.none(), st.none(), st.integers(1, 200))
pieces = st.sampled_from([1000, LARGE])


class Talk(RuleBasedStateMachine):
    """Tickets are the call ids, so that a response to the wrong call is found."""

    calls = Bundle("calls")

    @initialize()
    def connect(self):
        self.pair = open_pair(limits=LIMITS)
        self.pair.server.free_calls, self.pair.server.free_bytes = 2, 70
        self.sizes = {}
        """Every request ever made, with its bytes."""
        self.asked = set()
        """The call id of every RESOLVE."""
        self.ends = {}
        """How each call ended for its caller; each is set once."""
        self.cancelled = set()
        self.begun = {}
        """The calls that began in the server, and whether each has ended."""
        self.refused = set()
        """Calls that the server refused because of their quota."""
        self.freed = set()
        """Calls whose terminal frame the client has seen."""
        self.lost = False

    def end(self, ticket, outcome):
        assert ticket not in self.ends, f"call {ticket} ended twice"
        assert ticket not in self.cancelled, f"call {ticket} was cancelled and still ended"
        self.ends[ticket] = outcome

    # Actions of the caller

    @precondition(lambda self: len(self.made() - self.freed) <= LIMITS.calls)
    @rule(target=calls, size=sizes)
    def request(self, size):
        client = self.pair.client
        in_flight = self.made() - self.freed
        counted = sum(self.sizes.get(call, QUESTION) for call in in_flight)
        ticket = client.last_call_id + 1
        call_id = client.request(ticket, 1, bytes(size), 1000)
        assert bool(call_id) == (
            client.state is ConnectionState.OPEN
            and len(in_flight) < LIMITS.calls
            and (not in_flight or counted + size <= LIMITS.bytes)
        )
        if not call_id:
            return multiple()
        assert call_id == ticket
        self.sizes[ticket] = size
        return ticket

    @precondition(lambda self: self.pair.client.state is ConnectionState.OPEN)
    @precondition(lambda self: len(self.asked) < len(self.sizes))
    @rule(target=calls)
    def resolve(self):
        ticket = self.pair.client.last_call_id + 1
        assert self.pair.client.resolve(ticket, Resolve("/x")) == ticket
        self.asked.add(ticket)
        return ticket

    @precondition(lambda self: len(self.cancelled) * 3 < self.pair.client.last_call_id)
    @rule(call=calls)
    def cancel(self, call):
        self.pair.client.cancel(call)
        if call not in self.ends:
            self.cancelled.add(call)

    # Actions of the server's program

    @precondition(lambda self: not all(self.begun.values()))
    @rule(data=st.data(), size=sizes, how=st.sampled_from(["respond", "fail", "beside"]))
    def answer(self, data, size, how):
        serving = [call for call, done in self.begun.items() if not done]
        call = data.draw(st.sampled_from(serving))
        self.begun[call] = True
        server = self.pair.server
        if how == "fail":
            server.fail(call, TaskRpcError(f"no {call}"))
        elif how == "beside" and size < LARGE and server.state is ConnectionState.OPEN:
            frame, freed = server.pop_response(call, bytes(size), call)
            server.freed(freed)
            self.pair.wire[self.pair.client] += frame
        else:
            server.respond(call, bytes(size), call)

    @precondition(lambda self: any(self.begun.values()))
    @rule(data=st.data())
    def answer_again(self, data):
        done = [call for call, done in self.begun.items() if done]
        self.pair.server.respond(data.draw(st.sampled_from(done)), b"again")

    @precondition(lambda self: self.pair.client.last_call_id > 5)
    @rule()
    def drain(self):
        self.pair.server.drain()

    # Actions of the network

    @rule(count=counts, piece=pieces)
    def carry_to_server(self, count, piece):
        server = self.pair.server
        events = self.pair.deliver(server, count, piece=piece)
        for event in events:
            match event:
                case RequestReceived():
                    assert len(event.body) == self.sizes[event.call_id]
                    self.begin(event.call_id)
                case QuotaExceeded():
                    assert self.begun
                    self.begin(event.request.call_id)
                    if event.request.size % 2:
                        self.refuse(event.request.call_id)
                case LargeRequestBegan():
                    assert event.size > 70
                case ResolveReceived():
                    assert event.call_id in self.asked
                    self.begin(event.call_id)
                case CancelReceived():
                    assert event.call_id in self.cancelled
                    # A request that was refused just now arrived in the same read.
                    assert self.begun[event.call_id] is False or event.call_id in self.refused
                case _:
                    raise AssertionError(event)

        arriving = server.splitter.large
        if events and isinstance(events[-1], LargeRequestBegan) and arriving and arriving.size % 2:
            call = arriving.header[3]
            self.begun[call] = True
            server.skip_large(TaskRpcError(f"no {call}"))

    def refuse(self, call):
        self.refused.add(call)
        self.begun[call] = True
        self.pair.server.fail(call, TaskRpcError(f"no {call}"))

    def begin(self, call):
        assert call not in self.begun, f"call {call} began twice"
        assert self.ends.get(call) != "refused", f"call {call} began although it was refused"
        self.begun[call] = False

    @rule(count=counts, piece=pieces)
    def carry_to_client(self, count, piece):
        events = self.pair.deliver(self.pair.client, count, piece=piece)
        for event in events:
            match event:
                case ResponseReceived():
                    assert event.server_time == event.ticket
                    self.end(event.ticket, "answered")
                case ErrorReceived():
                    assert str(event.error) == f"no {event.ticket}"
                    self.end(event.ticket, "failed")
                case Draining():
                    for ticket in event.refused:
                        self.end(ticket, "refused")
                        assert ticket not in self.begun
        if not self.lost:
            self.check_freed()

    def check_freed(self):
        """A terminal frame frees the call's place in the limits; so does GOAWAY before it began."""
        self.freed = self.made() - self.pair.client.open_calls.keys()
        for call in self.freed:
            refused = self.ends.get(call) == "refused" or call in self.cancelled
            assert self.begun.get(call, refused), f"call {call} was freed without an end"
        assert not self.ends.keys() - self.freed

    @precondition(lambda self: self.pair.client.last_call_id > 4 and not self.lost)
    @rule()
    def lose(self):
        for ticket in self.pair.client.lost():
            self.end(ticket, "lost")
        self.pair.server.lost()
        self.begun = dict.fromkeys(self.begun, True)  # no call needs a response any more
        self.pair.wire = {end: bytearray() for end in self.pair.wire}
        self.lost = True
        # Every call has ended, exactly once.
        assert self.ends.keys() | self.cancelled == self.made()

    def made(self):
        return set(self.sizes) | self.asked

    @invariant()
    def limits_hold(self):
        if hasattr(self, "pair"):
            client, server = self.pair.client, self.pair.server
            questions = len(self.asked)
            assert client.in_flight <= LIMITS.calls + questions
            assert server.in_flight <= LIMITS.calls + questions
            assert server.in_flight == list(self.begun.values()).count(False)
            if not self.lost:
                assert ConnectionState.CLOSED not in (client.state, server.state)

    def teardown(self):
        """Answer and carry over everything: then every call has ended, and nothing is held."""
        if not hasattr(self, "pair") or self.lost:
            return
        self.carry_to_server(None, LARGE)
        for call, done in self.begun.items():
            if not done:
                self.pair.server.respond(call, b"", call)
                self.begun[call] = True
        self.carry_to_client(None, LARGE)
        assert self.pair.client.in_flight == self.pair.server.in_flight == 0
        assert self.ends.keys() | self.cancelled == self.made()


TestTalk = Talk.TestCase
TestTalk.settings = settings(max_examples=examples(60), stateful_step_count=40)
