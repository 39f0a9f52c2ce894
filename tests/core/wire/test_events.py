"""The events of a session about requests that exceed a quota."""

import pytest

from taskrpc.core.wire.connection_state import ConnectionState
from taskrpc.core.wire.events import (
    LargeRequestBegan,
    QuotaExceeded,
    RequestReceived,
)
from taskrpc.core.wire.frames import LARGE, FrameType, pack_header
from taskrpc.errors import (
    ServerBusy,
)
from tests.core.wire.helpers import open_pair, receive


def types(events):
    return [type(event) for event in events]


@pytest.mark.parametrize(("second", "kind"), [(5, RequestReceived), (6, QuotaExceeded)])
def test_a_request_over_the_free_bytes_exceeds_the_quota(second, kind):
    pair = open_pair()
    pair.server.free_bytes = 10
    pair.client.request("a", 3, bytes(5), 250)
    pair.client.request("b", 3, bytes(second), 250)
    assert types(pair.deliver(pair.server)) == [RequestReceived, kind]


def test_large_request_that_exceeds_the_free_bytes_is_announced_once_and_can_be_refused():
    pair = open_pair()
    server, size = pair.server, 2 * LARGE
    server.free_bytes = LARGE
    refused = pair.client.request("large", 3, bytes(size), 250)
    pair.client.request("small", 4, b"x", 250)
    assert pair.deliver(server, LARGE) == [LargeRequestBegan(3, size)]
    assert server.bytes_coming == size
    server.skip_large(ServerBusy("no room", retry_after=0.5))
    assert types(pair.deliver(server)) == [RequestReceived], "the rest is not announced again"
    (failed,) = pair.deliver(pair.client)
    assert (failed.ticket, str(failed.error)) == ("large", "no room")
    assert server.last_call_id == refused + 1
    assert (server.in_flight, server.bytes_in_flight) == (1, 1)


def test_only_a_request_that_may_begin_is_announced():
    header = pack_header(FrameType.REQUEST, 0, 3, 1, 250, 2 * LARGE)
    publish = pack_header(FrameType.PUBLISH, 0, 3, 9, 250, 2 * LARGE)
    for data, state, announced in (
        (header, ConnectionState.OPEN, True),
        (header, ConnectionState.DRAINING, False),
        (publish, ConnectionState.OPEN, False),
    ):
        server = open_pair().server
        server.free_bytes, server.state = LARGE, state
        events = receive(server, data + bytes(100))
        assert (types(events) == [LargeRequestBegan]) is announced


def test_nothing_is_skipped_where_nothing_large_arrives():
    server = open_pair().server
    server.skip_large(ServerBusy("no room", retry_after=0.5))
    assert not server.take()
