"""The token of an account identifies it; other callers learn nothing about the account."""

import hashlib
import hmac

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from taskrpc import Account, Accounts, AuthenticationFailed, Role, TaskRpcError
from taskrpc.core.wire import messages
from taskrpc.core.wire.connection_state import ConnectionState
from taskrpc.core.wire.events import Closed, Ready
from taskrpc.core.wire.frames import MAGIC, FrameType, pack_frame
from taskrpc.core.wire.handshake import PeerCredentials
from taskrpc.core.wire.messages import Auth, Hello
from taskrpc.core.wire.session import Session
from tests.core.wire.helpers import CLIENT, SERVER, TOKEN, ConnectionPair, receive
from tests.properties import examples

ANA = Account("ana", "anas-secret-anas", Role.OPERATE)
ACCOUNTS = Accounts(
    [
        ANA,
        Account("late", "lates-secret-late", expires=50.0),
        Account("gone", "gones-secret-gone", revoked=True),
    ]
)
KNOWING = replace(SERVER, accounts=ACCOUNTS, today=100.0)
CERTIFICATE = PeerCredentials("ana")
OWNER = PeerCredentials("", is_owner=True)


def shaken(token=b"", server=KNOWING, credentials=None, trusted=None):
    """What both sides learn of a handshake."""
    pair = ConnectionPair(replace(CLIENT, token=token), server)
    if credentials is not None:
        pair.server.set_peer_credentials(credentials)
    if trusted is not None:
        pair.client.set_peer_credentials(trusted)
    at_client, at_server = pair.run()
    return at_client, at_server[-1] if at_server else None


def right(event):
    assert isinstance(event, Ready), event
    account = event.peer.account
    return ("", Role.ADMIN) if account is None else (account.name, account.role)


def why_not(event):
    assert isinstance(event, Closed), event
    assert isinstance(event.error, AuthenticationFailed)
    return str(event.error), *event.error.__notes__


def test_the_token_of_an_account_identifies_the_account():
    at_client, at_server = shaken(ANA.token.encode())
    assert right(at_server) == ("ana", Role.OPERATE)
    assert isinstance(at_client[-1], Ready)


def test_the_servers_own_token_opens_everything():
    assert right(shaken(TOKEN)[1]) == ("", Role.ADMIN)


def test_a_servers_own_token_may_look_like_an_accounts():
    own = b"robot.with-a-dot"
    for accounts in (None, ACCOUNTS):
        server = replace(KNOWING, token=own, accounts=accounts)
        assert right(shaken(own, server)[1]) == ("", Role.ADMIN)


REFUSED = {
    b"ana.guess": "it does not know the secret of the account ana",
    b"eve.anas-secret-anas": "there is no account eve",
    b"late.lates-secret-late": "the account late has expired",
    b"gone.gones-secret-gone": "the account gone is revoked",
    b"anas-secret-anas": "it does not know this server's token",
}


@pytest.mark.parametrize("token", REFUSED)
def test_every_refused_caller_hears_the_same_and_only_the_log_says_why(token):
    at_client, at_server = shaken(token)
    assert why_not(at_server) == ("the token is not this server's", REFUSED[token])
    (heard,) = at_client
    assert str(heard.error) == "the token is not this server's"
    assert not hasattr(heard.error, "__notes__")


@pytest.mark.parametrize("token", REFUSED)
def test_every_refusal_costs_the_same_proofs_and_comparisons(token, monkeypatch):
    work = []
    digest, compare = hmac.digest, hmac.compare_digest
    monkeypatch.setattr(hmac, "digest", lambda *a: work.append("digest") or digest(*a))
    monkeypatch.setattr(hmac, "compare_digest", lambda *a: work.append("compare") or compare(*a))
    shaken(token)
    # The client's own proof, then the one that the server expects.
    assert work == ["digest", "digest", "compare"]


def test_a_server_without_accounts_knows_only_its_own_token():
    told = why_not(shaken(ANA.token.encode(), SERVER)[1])
    assert told[1] == "it does not know this server's token"


@pytest.mark.parametrize(
    ("credentials", "accounts", "expected"),
    [
        (CERTIFICATE, ACCOUNTS, ("ana", Role.OPERATE)),
        (CERTIFICATE, None, ("", Role.ADMIN)),
        (OWNER, ACCOUNTS, ("", Role.ADMIN)),
        (OWNER, None, ("", Role.ADMIN)),
    ],
)
def test_peer_credentials_replace_a_token(credentials, accounts, expected):
    server = replace(KNOWING, accounts=accounts)
    assert right(shaken(b"", server, credentials, trusted=OWNER)[1]) == expected


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("eve", "by its certificate there is no account eve"),
        ("late", "by its certificate the account late has expired"),
        ("gone", "by its certificate the account gone is revoked"),
    ],
)
def test_a_certificate_of_no_account_is_refused_where_there_are_accounts(name, why):
    assert why_not(shaken(b"", KNOWING, PeerCredentials(name), trusted=OWNER)[1])[1] == why
    no_accounts = replace(KNOWING, accounts=Accounts())
    assert why_not(shaken(b"", no_accounts, PeerCredentials(name), trusted=OWNER)[1])[1].startswith(
        "by its"
    )


def test_an_account_is_believed_before_the_certificate_beside_it():
    assert right(shaken(TOKEN, KNOWING, CERTIFICATE)[1]) == ("", Role.ADMIN)
    assert right(shaken(ANA.token.encode(), KNOWING, PeerCredentials("eve"))[1])[0] == "ana"


def test_the_empty_token_is_refused_without_peer_credentials():
    told = why_not(shaken(b"", trusted=OWNER)[1])
    assert told == ("the token is not this server's", "it does not know this server's token")


def test_a_wrong_token_is_not_helped_by_a_certificate():
    told = why_not(shaken(b"ana.guess", KNOWING, CERTIFICATE)[1])
    assert told[1] == "it does not know the secret of the account ana"


def test_a_client_proves_the_empty_token_only_to_a_server_that_has_proved_itself():
    at_client, at_server = shaken(b"", KNOWING, CERTIFICATE)
    assert at_server is None
    assert str(at_client[-1].error) == "its secret is needed (token, TASKRPC_TOKEN)"


# Whatever a stranger puts together

KEYS = {
    "own": TOKEN,
    "empty": b"",
    "guess": b"ana.guess",
    "no account": b"eve.eves-secret-eves",
    **{each.name: each.token.encode() for each in ACCOUNTS},
}
NAMES = st.sampled_from(["", "ana", "late", "gone", "eve", "Ana", "ana."]) | st.text(
    "an.@ é", max_size=5
)
CREDENTIALS = st.none() | st.sampled_from(
    [OWNER, *map(PeerCredentials, ["ana", "late", "eve", ""])]
)


def control(type_, body):
    return pack_frame(type_, 0, 0, 0, 0, messages.encode(body))


def proof(key, role, mine, theirs):
    return Auth(hmac.digest(key, b"taskrpc " + role + mine + theirs, hashlib.sha256))


def deserved(name, key, credentials, accounts):
    """Return the expected account and role by the documentation; None if it must be refused."""
    if key == ("ana" if name == "ana" and accounts else "own"):
        return ("ana", Role.OPERATE) if key == "ana" else ("", Role.ADMIN)
    if key != "empty" or credentials is None:
        return None
    if credentials.is_owner or not accounts:
        return "", Role.ADMIN
    return ("ana", Role.OPERATE) if credentials.name == "ana" else None


@given(
    NAMES,
    st.sampled_from(list(KEYS)),
    CREDENTIALS,
    st.sampled_from([b"client", b"client", b"client", b"server", b""]),
    st.sampled_from([SERVER.nonce, SERVER.nonce, SERVER.nonce, bytes(16), CLIENT.nonce]),
    st.booleans(),
)
@settings(max_examples=examples(200))
def test_a_caller_gets_only_the_role_that_it_proves(
    name, key, credentials, role, theirs, with_accounts
):
    server = replace(KNOWING, accounts=ACCOUNTS if with_accounts else None)
    session = Session(server, is_client=False)
    if credentials is not None:
        session.set_peer_credentials(credentials)
    hello = Hello(1, 1, CLIENT.id, CLIENT.nonce, 0, "/stranger", name)
    auth = proof(KEYS[key], role, CLIENT.nonce, theirs)
    stream = MAGIC + control(FrameType.HELLO, hello) + control(FrameType.AUTH, auth)
    *_, event = receive(session, stream)
    expected = deserved(name, key, credentials, with_accounts)
    if role != b"client" or theirs != SERVER.nonce:
        expected = None
    assert (right(event) if isinstance(event, Ready) else None) == expected


def conversation(token, number, credentials=None):
    """What both sides of one connection say, frame by frame; its nonces are its own."""
    mine, theirs = (bytes([number, side]) * 8 for side in (1, 2))
    pair = ConnectionPair(replace(CLIENT, token=token, nonce=mine), replace(KNOWING, nonce=theirs))
    if credentials is not None:
        pair.server.set_peer_credentials(credentials)
        pair.client.set_peer_credentials(credentials)
    said = []
    for end in (pair.server, pair.client) * 2:
        pair.collect()
        said.append(bytes(pair.wire[end]).removeprefix(MAGIC))
        pair.deliver(end)
    assert pair.server.state is ConnectionState.OPEN
    return said


OVERHEARD = [
    frame
    for number, (token, credentials) in enumerate(
        [(TOKEN, None), (ANA.token.encode(), None), (b"", CERTIFICATE), (b"", OWNER)]
    )
    for frame in conversation(token, number, credentials)
]


@given(st.lists(st.sampled_from(OVERHEARD), max_size=6), st.data())
@settings(max_examples=examples(150))
def test_recorded_handshakes_cannot_be_replayed(frames, data):
    stream = bytearray(b"".join(frames))
    for place in data.draw(st.lists(st.integers(0, 500), max_size=3)):
        if place < len(stream):
            stream[place] ^= data.draw(st.integers(1, 255))
    for is_client in (False, True):
        me = replace(CLIENT, token=ANA.token.encode()) if is_client else KNOWING
        session = Session(me, is_client=is_client)
        events = receive(session, (b"" if is_client else MAGIC) + bytes(stream))
        assert all(isinstance(event, Closed) for event in events)
        assert all(isinstance(event.error, TaskRpcError) for event in events)
