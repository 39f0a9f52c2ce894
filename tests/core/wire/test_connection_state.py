"""The state of a connection changes only as its table allows."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.core.wire.base_session import BaseSession
from taskrpc.core.wire.connection_state import TRANSITIONS, ConnectionState, StateEvent, next_state
from taskrpc.core.wire.frames import FrameType, pack_frame
from taskrpc.core.wire.messages import Resolve
from taskrpc.errors import ProtocolError
from tests.core.wire.helpers import CLIENT, SERVER, ConnectionPair

CLOSED = ConnectionState.CLOSED


@given(st.lists(st.sampled_from(StateEvent)))
def test_every_sequence_of_events_stays_in_the_table(events):
    state = ConnectionState.HANDSHAKE
    for event in events:
        if (state, event) in TRANSITIONS:
            state = next_state(state, event)
        else:
            with pytest.raises(AssertionError, match="got the event"):
                next_state(state, event)


def test_a_connection_never_goes_back():
    order = list(ConnectionState)
    for (before, _), after in TRANSITIONS.items():
        assert order.index(before) <= order.index(after)
    assert all((state, StateEvent.END) in TRANSITIONS for state in ConnectionState)


ACTIONS = {
    "deliver": lambda pair, end: pair.run(),
    "drain": lambda pair, end: end.drain(),
    "close": lambda pair, end: end.close(),
    "reject": lambda pair, end: end.reject(ProtocolError("rejected")),
    "lose": lambda pair, end: end.lost(),
    "ping": lambda pair, end: end.ping(1),
    "advertise": lambda pair, end: end.advertise(),
    "request": lambda pair, end: end.is_client and end.request("ticket", 1, b"", 1000),
    "resolve": lambda pair, end: end.is_client and end.resolve("ticket", Resolve("/add")),
    "goaway": lambda pair, end: list(end.feed(pack_frame(FrameType.GOAWAY, 0, 0, 0, 0))),
    "garbage": lambda pair, end: list(end.feed(b"\xff" * 20)),
}


@given(st.lists(st.tuples(st.sampled_from(sorted(ACTIONS)), st.booleans()), max_size=12))
def test_two_ends_change_their_states_only_by_the_table(steps):
    pair, seen = ConnectionPair(CLIENT, SERVER), []
    with pytest.MonkeyPatch.context() as patch:
        advance = BaseSession.advance

        def recorded(session, event):
            before = session.state
            advance(session, event)
            seen.append((before, event))

        patch.setattr(BaseSession, "advance", recorded)
        for action, at_client in steps:
            end = pair.client if at_client else pair.server
            was_closed = end.state is CLOSED
            ACTIONS[action](pair, end)
            assert not was_closed or end.state is CLOSED
    assert set(seen) <= set(TRANSITIONS)
