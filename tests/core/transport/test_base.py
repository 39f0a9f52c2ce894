"""An incoming call without a connection: what it tells its service by default."""

from taskrpc.core.request_ids.ids import ReceivedId
from taskrpc.core.security.roles import Role
from taskrpc.core.transport.base import IncomingCall


def call(**options):
    facts = {"service": "/add", "caller": "/robot", "principal": "", "role": Role.ADMIN}
    return IncomingCall(
        **facts,
        number=1,
        deadline=None,
        clock=lambda: 0.0,
        request=None,
        arrived=0.0,
        **options,
    )


def test_cancelling_stops_the_run_of_a_call():
    stopped = []
    one = call(on_cancel=lambda: stopped.append(1))
    one.cancel()
    assert (one.cancelled, stopped) == (True, [1])
    call().cancel()


def test_a_lost_connection_cancels_only_calls_that_cannot_be_repeated():
    one = call()
    one.lost()
    assert one.cancelled
    other = call(received_id=ReceivedId(b"client", 1, 1, b""))
    other.lost()
    assert not other.cancelled


def test_calls_of_one_account_or_caller_keep_their_order():
    assert call().flow == "/robot"
    one = call()
    one.principal = "ana"
    assert one.flow == "ana"


def test_a_call_needs_no_room_and_no_thread_by_default():
    one = call()
    assert not one.must_wait()
    assert not one.reply_in_thread(b"")
    one.note_repetition()
