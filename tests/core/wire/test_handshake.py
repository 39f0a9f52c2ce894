"""Without the token, a caller is refused with one clear sentence."""

import hmac

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from taskrpc.core.wire import messages
from taskrpc.core.wire.base_session import HANDSHAKE_LIMIT
from taskrpc.core.wire.connection_state import ConnectionState
from taskrpc.core.wire.events import (
    Closed,
    LargeRequestBegan,
    Ready,
    RequestReceived,
    ServicesChanged,
)
from taskrpc.core.wire.frames import LARGE, MAGIC, FrameType, pack_frame
from taskrpc.core.wire.handshake import PeerCredentials
from taskrpc.core.wire.messages import DEFAULT_LIMITS, Auth, Hello, HelloAck, Limits, Resolve
from taskrpc.core.wire.session import Session
from taskrpc.errors import AuthenticationFailed, ProtocolError, TaskRpcError
from tests.core.wire.helpers import (
    CLIENT,
    SERVER,
    Comparisons,
    ConnectionPair,
    open_pair,
    receive,
)
from tests.properties import examples


def hello(**changes):
    fields = {
        "lowest": 1,
        "highest": 1,
        "client_id": CLIENT.id,
        "nonce": CLIENT.nonce,
        "domain": 0,
        "name": "/caller",
    }
    return messages.encode(Hello(**(fields | changes)))


def control(type_, body=b""):
    return pack_frame(type_, 0, 0, 0, 0, body)


def server_after(*frames):
    """A server that was sent these frames behind the magic bytes, and what it made of them."""
    server = Session(SERVER, is_client=False)
    return server, receive(server, MAGIC + b"".join(frames))


def why_closed(events):
    assert isinstance(events[-1], Closed)
    assert not any(isinstance(event, Ready) for event in events)
    return events[-1].error


@pytest.mark.parametrize("token", [CLIENT.token, b"another token"])
def test_proofs_are_compared_by_compare_digest_and_in_no_other_way(token, monkeypatch):
    comparisons = Comparisons().watch(monkeypatch)
    pair = ConnectionPair(replace(CLIENT, token=token))
    pair.server.set_peer_credentials(
        PeerCredentials("", is_owner=True)
    )  # so that the empty token is compared as well
    pair.run()
    assert comparisons.received == 1 + (token == CLIENT.token)
    assert comparisons.in_constant_time == 2
    assert comparisons.by_hand == 0


@pytest.mark.parametrize("piece", [1, 7, 65_536])
def test_both_sides_prove_the_token_and_know_each_other(piece):
    pair = ConnectionPair(limits=Limits(body=1000, calls=3, bytes=2000))
    (at_client,), (at_server,) = pair.run(piece=piece)
    assert isinstance(at_client, Ready)
    assert at_client.peer.id == SERVER.id
    assert at_client.peer.limits == Limits(1000, 3, 2000)
    assert isinstance(at_server, Ready)
    assert (at_server.peer.id, at_server.peer.name) == (CLIENT.id, "/caller")
    assert pair.client.state is pair.server.state is ConnectionState.OPEN
    assert pair.client.body_limit == 1000
    assert pair.server.body_limit == DEFAULT_LIMITS.body


def test_a_client_with_a_wrong_token_is_refused_with_a_reason():
    pair = ConnectionPair(client=replace(CLIENT, token=b"guess"))
    at_client, at_server = pair.run()
    assert isinstance(why_closed(at_server), AuthenticationFailed)
    assert isinstance(why_closed(at_client), AuthenticationFailed)
    assert str(at_client[-1].error) == "the token is not this server's"
    assert at_client[-1].error.not_executed is True


def test_a_server_that_does_not_know_the_token_is_left():
    pretender = Session(replace(SERVER, token=b"none"), is_client=False)
    client = Session(CLIENT, is_client=True)
    receive(pretender, b"".join(client.take()))
    receive(client, b"".join(pretender.take()))
    forged = control(FrameType.AUTH_OK, messages.encode(Auth(bytes(32))))
    assert isinstance(why_closed(receive(client, forged)), AuthenticationFailed)


def test_a_server_cannot_send_the_clients_own_proof_back():
    client = Session(CLIENT, is_client=True)
    client.take()
    # With equal nonces, only the role distinguishes the two proofs.
    ack = HelloAck(1, SERVER.id, CLIENT.nonce, DEFAULT_LIMITS)
    assert receive(client, control(FrameType.HELLO_ACK, messages.encode(ack))) == []
    (auth,) = client.take()
    reflected = control(FrameType.AUTH_OK, auth[16:])
    assert isinstance(why_closed(receive(client, reflected)), AuthenticationFailed)


def test_a_recorded_handshake_does_not_open_another_connection():
    pair = ConnectionPair()
    pair.collect()
    first = bytes(pair.wire[pair.server])
    pair.deliver(pair.server)
    pair.deliver(pair.client)
    pair.collect()
    second = bytes(pair.wire[pair.server])
    assert [type(event) for event in pair.deliver(pair.server)] == [Ready]

    other = Session(replace(SERVER, nonce=b"t" * 16), is_client=False)
    assert isinstance(why_closed(receive(other, first + second)), AuthenticationFailed)


@pytest.mark.parametrize(("mine", "theirs"), [(b"", b"k"), (b"k", b""), (b"k", b"l")])
def test_a_proof_holds_for_its_own_connection_only(mine, theirs):
    pair = ConnectionPair()
    pair.client.set_peer_credentials(None, mine)
    pair.server.set_peer_credentials(None, theirs)
    at_client, at_server = pair.run()
    assert isinstance(why_closed(at_server), AuthenticationFailed)
    assert isinstance(why_closed(at_client), AuthenticationFailed)


def test_both_sides_know_the_same_of_an_encrypted_connection():
    pair = ConnectionPair()
    for end in (pair.client, pair.server):
        end.set_peer_credentials(None, b"k" * 32)
    pair.run()
    assert pair.client.state is pair.server.state is ConnectionState.OPEN


def test_a_server_that_believes_to_speak_on_another_connection_is_left():
    """The peer proves the token, but over another connection: an attacker relays it."""
    client, server = Session(CLIENT, is_client=True), Session(SERVER, is_client=False)
    server.set_peer_credentials(None, b"k")
    receive(server, b"".join(client.take()))
    receive(client, b"".join(server.take()))
    nonces = CLIENT.nonce + SERVER.nonce
    forged = hmac.digest(SERVER.token, b"taskrpc server" + nonces + b"k", "sha256")
    answer = control(FrameType.AUTH_OK, messages.encode(Auth(forged)))
    assert isinstance(why_closed(receive(client, answer)), AuthenticationFailed)


@pytest.mark.parametrize(
    ("lowest", "highest", "welcome"),
    [(1, 1, True), (0, 1, True), (1, 9, True), (2, 9, False), (0, 0, False), (9, 0, False)],
)
def test_a_client_is_welcome_when_its_range_has_our_version(lowest, highest, welcome):
    server, events = server_after(control(FrameType.HELLO, hello(lowest=lowest, highest=highest)))
    assert (events == []) is welcome
    if not welcome:
        error = why_closed(events)
        assert isinstance(error, ProtocolError)
        assert str(error) == f"this server speaks version 1, the client {lowest} to {highest}"
        client = Session(CLIENT, is_client=True)
        told = receive(client, b"".join(server.take()))
        assert str(why_closed(told)) == str(error)


def test_a_server_of_another_version_is_left():
    client = Session(CLIENT, is_client=True)
    ack = messages.encode(HelloAck(2, SERVER.id, SERVER.nonce, DEFAULT_LIMITS))
    error = why_closed(receive(client, control(FrameType.HELLO_ACK, ack)))
    assert str(error) == "the server speaks version 2; this is 1"


def test_another_domain_is_refused_by_name_before_any_proof():
    pair = ConnectionPair(client=replace(CLIENT, domain=7))
    at_client, at_server = pair.run()
    sentence = "this server is in domain 0, the client in domain 7 (ROS_DOMAIN_ID)"
    assert str(why_closed(at_server)) == str(why_closed(at_client)) == sentence


def test_a_greeting_over_four_kibibytes_is_refused_by_its_header_alone():
    header = pack_frame(FrameType.HELLO, 0, 0, 0, 0, bytes(HANDSHAKE_LIMIT + 1))[:16]
    server, events = server_after(header)
    assert str(why_closed(events)) == "a frame of 4097 bytes; at most 4096 are accepted"
    assert b"at most 4096 are accepted" in b"".join(server.take())


STRANGERS = {
    "browser": b"GET /robot HTTP/1.1\r\nHost: localhost\r\n\r\n",
    "TLS ClientHello": bytes.fromhex("16030100c8010000c40303") + bytes(200),
    "ssh": b"SSH-2.0-OpenSSH_9.6\r\n",
    "almost": b"TRPD" + bytes(100),
    "lower case": b"trpc" + bytes(100),
    "zeros": bytes(64),
}


@pytest.mark.parametrize("piece", [1, 3, 65_536])
@pytest.mark.parametrize("name", STRANGERS)
def test_a_stranger_is_closed_at_once_and_hears_nothing(name, piece):
    server = Session(SERVER, is_client=False)
    events = receive(server, STRANGERS[name], piece)
    assert len(events) == 1
    error = why_closed(events)
    assert isinstance(error, ProtocolError)
    assert str(error).startswith("the peer does not speak taskrpc: it began with b'")
    assert server.state is ConnectionState.CLOSED
    assert not server.out


@pytest.mark.parametrize("beginning", [MAGIC[:1], MAGIC[:3], MAGIC, MAGIC + b"\x00" * 3])
def test_a_beginning_that_may_still_become_a_handshake_is_waited_for(beginning):
    server = Session(SERVER, is_client=False)
    assert receive(server, beginning) == []
    assert server.state is ConnectionState.HANDSHAKE


BAD_GREETINGS = {
    "empty": b"",
    "not an array": b"\xa3abc",
    "text that is not UTF-8": hello(name="x")[:-1] + b"\xff",
    "too deep": hello().replace(b"\x97", b"\x98", 1) + b"\x91" * 4000,
    "short id": hello(client_id=b"short"),
    "long nonce": hello(nonce=bytes(17)),
    "text for a number": messages.encode(["1", 1, CLIENT.id, CLIENT.nonce, 0, ""]),
    "number beyond 64 bits": b"\x97\xcf" + b"\xff" * 7,
    "long name": hello(name="n" * 513),
    "name that drives a terminal": hello(name="\x1b[2J"),
    "name of two lines": hello(name="a\nb"),
    "cut short": hello()[:-3],
    "bytes behind": hello() + b"\x00",
    "lying length": b"\xdd\xff\xff\xff\xff\x01",
}


@pytest.mark.parametrize("name", BAD_GREETINGS)
def test_a_greeting_that_is_none_is_a_protocol_error(name):
    server, events = server_after(control(FrameType.HELLO, BAD_GREETINGS[name]))
    error = why_closed(events)
    assert type(error) is ProtocolError
    assert str(error).startswith("Hello is not valid: ")
    assert server.out  # the client gets the reason


@pytest.mark.parametrize(
    ("frames", "type_"),
    [
        ([control(FrameType.AUTH, messages.encode(Auth(bytes(32))))], 3),
        ([control(FrameType.HELLO, hello()), control(FrameType.HELLO, hello())], 1),
        ([control(FrameType.REQUEST)], 7),
        ([control(FrameType.HELLO, hello()), control(FrameType.RESOLVE)], 6),
        ([control(FrameType.PING)], 11),
        ([control(0)], 0),
    ],
)
def test_only_handshake_frames_in_order_are_accepted_before_the_proof(frames, type_):
    _, events = server_after(*frames)
    sentence = f"expected the client's handshake, got frame type {type_}"
    assert str(why_closed(events)) == sentence


@pytest.mark.parametrize("type_", [FrameType.AUTH_OK, FrameType.HELLO, FrameType.RESPONSE, 127])
def test_a_client_expects_the_servers_handshake(type_):
    client = Session(CLIENT, is_client=True)
    sentence = f"expected the server's handshake, got frame type {int(type_)}"
    assert str(why_closed(receive(client, control(type_)))) == sentence


def test_frames_that_may_be_skipped_are_skipped_in_the_handshake_too():
    extra = control(0x80, b"news")
    server, events = server_after(extra, control(FrameType.HELLO, hello()), extra)
    assert events == []
    client = Session(CLIENT, is_client=True)
    assert receive(client, extra + b"".join(server.take())) == []
    assert client.state is ConnectionState.HANDSHAKE


@pytest.mark.parametrize(
    "limits",
    [[0, 1, 1], [1, 0, 1], [1, 1, -1], [2**31 + 1, 1, 1], [2**63, 1, 1], ["a"], [1.5, 1, 1]],
)
def test_a_server_cannot_make_a_client_believe_in_impossible_limits(limits):
    client = Session(CLIENT, is_client=True)
    ack = messages.encode([1, SERVER.id, SERVER.nonce, limits])
    error = why_closed(receive(client, control(FrameType.HELLO_ACK, ack)))
    assert type(error) is ProtocolError


def handshake_stream():
    """Return all bytes of a client's handshake with the server of `SERVER`."""
    pair = ConnectionPair()
    pair.collect()
    stream = bytes(pair.wire[pair.server])
    pair.deliver(pair.server)
    pair.deliver(pair.client)
    pair.collect()
    return stream + bytes(pair.wire[pair.server])


BEHIND = pack_frame(FrameType.REQUEST, 0, 1, 1, 50, b"z" * 5000) + pack_frame(
    FrameType.REQUEST, 0, 1, 2, 50, b"y" * (LARGE + 5)
)


@given(st.lists(st.integers(0, len(handshake_stream() + BEHIND)), max_size=8))
@settings(max_examples=examples(80))
def test_a_handshake_and_later_frames_may_arrive_in_any_pieces(cuts):
    stream = handshake_stream() + BEHIND
    server = Session(SERVER, is_client=False)
    events = []
    edges = sorted(cuts)
    for start, end in zip([0, *edges], [*edges, len(stream)], strict=True):
        events += receive(server, stream[start:end])
    # A request that arrives in one piece is not announced.
    events = [event for event in events if not isinstance(event, LargeRequestBegan)]
    assert [type(event) for event in events] == [Ready, RequestReceived, RequestReceived]
    assert [len(event.body) for event in events[1:]] == [5000, LARGE + 5]


def test_frames_directly_behind_the_handshake_are_handled():
    pair = ConnectionPair()
    pair.deliver(pair.server)
    pair.deliver(pair.client)
    pair.deliver(pair.server)
    pair.server.advertise()
    assert [type(event) for event in pair.deliver(pair.client)] == [Ready, ServicesChanged]


def test_an_empty_question_is_a_listing():
    pair = open_pair()
    pair.client.resolve("ticket", Resolve(""))
    (event,) = pair.deliver(pair.server)
    assert event.question == Resolve("", "")


def test_secrets_are_not_in_a_repr():
    assert "token" not in repr(CLIENT)
    assert CLIENT.token.decode("latin-1").rstrip("\0") not in repr(CLIENT)


@given(st.binary(max_size=300), st.booleans(), st.booleans())
@settings(max_examples=examples(150))
def test_garbage_in_a_handshake_only_closes(data, is_client, with_magic):
    session = Session(CLIENT if is_client else SERVER, is_client=is_client)
    events = receive(session, (MAGIC if with_magic else b"") + data)
    assert all(isinstance(event, Closed) for event in events)
    assert session.state in (ConnectionState.HANDSHAKE, ConnectionState.CLOSED)
    assert all(isinstance(event.error, TaskRpcError) for event in events)


@given(st.data())
@settings(max_examples=examples(150))
def test_a_changed_byte_in_a_handshake_never_raises_and_never_lets_a_stranger_in(data):
    stream = bytearray(handshake_stream())
    place = data.draw(st.integers(0, len(stream) - 1))
    stream[place] ^= data.draw(st.integers(1, 255))
    server = Session(SERVER, is_client=False)
    events = receive(server, bytes(stream))
    proof = stream[-32:] != handshake_stream()[-32:]
    assert not (proof and any(isinstance(event, Ready) for event in events))
