"""Each event of a session has a handler at the end that gets it."""

from typing import get_args

import pytest

from taskrpc.core.transport.connection.client_side import CallingConnection
from taskrpc.core.transport.connection.server_side import ServingConnection
from taskrpc.core.wire.events import Event
from taskrpc.core.wire.frames import FrameType, pack_frame
from tests.core.wire.helpers import open_pair, receive


def test_each_event_has_a_handler():
    handled = CallingConnection.handlers.keys() | ServingConnection.handlers.keys()
    assert handled == set(get_args(Event)), "`handlers` in client_side.py and server_side.py"


@pytest.mark.parametrize("type_", FrameType)
@pytest.mark.parametrize("side", [CallingConnection, ServingConnection])
def test_each_event_of_an_empty_frame_has_a_handler_at_its_end(side, type_):
    pair = open_pair()
    pair.client.request("ticket", 1, b"", 100)
    pair.run()
    end = pair.server if side.serves else pair.client
    for call_id in (1, 2):
        for event in receive(end, pack_frame(type_, 0, 0, call_id, 0)):
            assert type(event) in side.handlers
