"""Who proves an account's token is that account; who does not learns nothing of it."""

import hmac

import pytest
from msgspec.structs import replace

from taskrpc import Account, Accounts, AuthenticationFailed, Role
from taskrpc.wire.events import Closed, Ready
from taskrpc.wire.handshake import Voucher
from tests.taskrpc.wire.helpers import CLIENT, SERVER, TOKEN, ConnectionPair

ANA = Account("ana", "anas-secret-anas", Role.OPERATE)
ACCOUNTS = Accounts(
    [
        ANA,
        Account("late", "lates-secret-late", expires=50.0),
        Account("gone", "gones-secret-gone", revoked=True),
    ]
)
KNOWING = replace(SERVER, accounts=ACCOUNTS, today=100.0)
CERTIFICATE = Voucher("ana")
OWNER = Voucher("", is_owner=True)


def shaken(token=b"", server=KNOWING, voucher=None, trusted=None):
    """What both sides learn of a handshake."""
    pair = ConnectionPair(replace(CLIENT, token=token), server)
    if voucher is not None:
        pair.server.vouch(voucher)
    if trusted is not None:
        pair.client.vouch(trusted)
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


def test_who_proves_an_accounts_token_is_that_account():
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
    ("voucher", "accounts", "expected"),
    [
        (CERTIFICATE, ACCOUNTS, ("ana", Role.OPERATE)),
        (CERTIFICATE, None, ("", Role.ADMIN)),
        (OWNER, ACCOUNTS, ("", Role.ADMIN)),
        (OWNER, None, ("", Role.ADMIN)),
    ],
)
def test_what_the_connection_has_proved_stands_for_a_token(voucher, accounts, expected):
    server = replace(KNOWING, accounts=accounts)
    assert right(shaken(b"", server, voucher, trusted=OWNER)[1]) == expected


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("eve", "by its certificate there is no account eve"),
        ("late", "by its certificate the account late has expired"),
        ("gone", "by its certificate the account gone is revoked"),
    ],
)
def test_a_certificate_of_no_account_is_refused_where_there_are_accounts(name, why):
    assert why_not(shaken(b"", KNOWING, Voucher(name), trusted=OWNER)[1])[1] == why
    nobody = replace(KNOWING, accounts=Accounts())
    assert why_not(shaken(b"", nobody, Voucher(name), trusted=OWNER)[1])[1].startswith("by its")


def test_an_account_is_believed_before_the_certificate_beside_it():
    assert right(shaken(TOKEN, KNOWING, CERTIFICATE)[1]) == ("", Role.ADMIN)
    assert right(shaken(ANA.token.encode(), KNOWING, Voucher("eve"))[1])[0] == "ana"


def test_the_empty_token_opens_nothing_that_nobody_vouches_for():
    told = why_not(shaken(b"", trusted=OWNER)[1])
    assert told == ("the token is not this server's", "it does not know this server's token")


def test_a_wrong_token_is_not_helped_by_a_certificate():
    told = why_not(shaken(b"ana.guess", KNOWING, CERTIFICATE)[1])
    assert told[1] == "it does not know the secret of the account ana"


def test_a_client_proves_the_empty_token_only_to_a_server_that_has_proved_itself():
    at_client, at_server = shaken(b"", KNOWING, CERTIFICATE)
    assert at_server is None
    assert str(at_client[-1].error) == "its secret is needed (token, TASKRPC_TOKEN)"
