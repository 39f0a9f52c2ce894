"""A server that other machines can reach needs a certificate and authenticates its callers."""

import itertools

import pytest

import taskrpc
from taskrpc import Account, Accounts
from taskrpc.core.security.listen_policy import check_listen_policy
from taskrpc.core.transport.tcp.tcp_network import is_loopback

GOOD, SHORT = "t" * 16, "t" * 15
PROOFS = {
    "nothing": {},
    "token": {"token": GOOD},
    "short token": {"token": SHORT},
    "accounts": {"accounts": Accounts([Account("ana", GOOD)])},
    "no accounts yet": {"accounts": Accounts()},
    "short account": {"accounts": Accounts([Account("ana", SHORT)])},
    "ca": {"ca": True},
}
HOLDS = {"token", "accounts", "no accounts yet", "ca"}
HOSTS = {
    "127.0.0.1": True,
    "127.8.9.10": True,
    "localhost": True,
    "::1": True,
    "0.0.0.0": False,
    "::": False,
    "192.168.1.20": False,
    "::ffff:192.168.1.20": False,
    "robot.local": False,
    "127.0.0.1.evil.example": False,
}


def refused(host, certificate, proof):
    options = {"token": "", "accounts": None, "ca": False, **PROOFS[proof]}
    if is_loopback(host):
        return ""
    try:
        check_listen_policy(host, certificate=certificate, **options)
    except taskrpc.CannotListen as error:
        return str(error)
    return ""


TABLE = list(itertools.product(HOSTS, [False, True], PROOFS))


@pytest.mark.parametrize(("host", "certificate", "proof"), TABLE)
def test_listening_to_other_machines_needs_a_certificate_and_authentication(
    host, certificate, proof
):
    why = refused(host, certificate, proof)
    assert (why == "") is (HOSTS[host] or (certificate and proof in HOLDS))
    assert GOOD not in why
    if why:
        assert why.startswith(f"cannot listen at {host}: ")


def test_a_secret_that_can_be_guessed_is_named_with_its_length():
    assert refused("0.0.0.0", True, "short token").endswith(
        "the token has 15 characters; expected at least 16, because other machines can try to"
        " guess it"
    )
    assert "the secret of the account ana has 15" in refused("0.0.0.0", True, "short account")


def test_both_conditions_are_in_one_sentence():
    assert refused("0.0.0.0", False, "token") == (
        "cannot listen at 0.0.0.0: beyond this machine's own addresses (127.0.0.1, localhost, ::1)"
        " a server needs a certificate (--tls-cert and --tls-key, or tls=taskrpc.Tls(cert, key))"
        " and one of: a token (--token-file, token=), accounts (--accounts, accounts=), or an"
        " authority for its callers' certificates (--tls-ca, Tls(ca=))"
    )
