"""After any end of a connection, its memory is freed."""

import gc

import pytest

from taskrpc.core.wire.frames import FrameType, pack_frame
from tests.core.wire.helpers import open_pair, receive

OFFENCES = {
    "garbage": pack_frame(0x7F, 0, 0, 0, 0),
    "a length": bytes(16),
    "a body": pack_frame(FrameType.RESOLVE, 0, 0, 1, 0, b"\xc1" * 100),
}


@pytest.mark.parametrize("offence", OFFENCES)
def test_closed_connection_leaves_no_objects_behind(offence):
    """The traceback of an error refers to stack frames, which may refer to the error."""

    def offend():
        pair = open_pair()
        receive(pair.server, OFFENCES[offence])

    def objects():
        gc.collect()
        return len(gc.get_objects())

    offend()
    gc.collect()
    gc.freeze()  # the collector need not examine these objects again
    before = objects()
    for _ in range(50):
        offend()
    assert objects() - before < 50
