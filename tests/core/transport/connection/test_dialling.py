"""The error for an unreachable process says the reason and what to do."""

from __future__ import annotations

import asyncio
import errno
import logging

import pytest

import taskrpc
from taskrpc.core.security import lab
from taskrpc.core.transport.connection.client_side import HANDSHAKE_LOST
from taskrpc.core.transport.connection.dialling import Dialler
from taskrpc.core.transport.network import Address
from taskrpc.errors import AuthenticationFailed, ConnectionLost, ProtocolError
from tests.core.transport.helpers import Add, ask

PLACE = "192.0.2.7:7450"
HERE = Address(PLACE, b"", pid=4711, script="server.py")
PEER = Address(PLACE, b"half.of.a.secret")
LAB = Address(PLACE, b"ana.k.secret-of-ana", certificate="PEM", domain=0)


class Plain:
    """A transport without TLS."""

    def get_extra_info(self, name):
        assert name == "ssl_object"


class Connection:
    """A connection whose handshake fails or never ends."""

    transport = Plain()
    why_closed = None
    is_open = False

    def __init__(self, error):
        self.ready = asyncio.get_running_loop().create_future()
        if error is not None:
            self.ready.set_exception(error)

    def abort(self, error):
        pass


class Net:
    """A network on which dialling works, or raises; it lists no program."""

    def entries(self):
        return []

    peers = entries

    def __init__(self, error=None):
        self.error = error

    async def dial(self, address, factory):
        if self.error is not None:
            raise self.error


async def failure(address, in_handshake=None, *, in_dialling=None):
    """The error that a caller gets for an address."""
    dialler = Dialler(Net(in_dialling), lambda _: Connection(in_handshake))
    with pytest.raises(taskrpc.TaskRpcError) as caught:
        await dialler.connection(address, None)
    return caught.value


@pytest.mark.parametrize("error", [None, ConnectionLost("no handshake within 3 s")])
async def test_error_names_a_stopped_process_and_how_to_continue_it(monkeypatch, error):
    monkeypatch.setattr("taskrpc.core.system.process_state.is_stopped", lambda pid: pid == 4711)
    found = await failure(HERE, error)
    assert isinstance(found, ConnectionLost)
    assert found.not_executed
    assert str(found) == (
        "server.py (pid 4711) is stopped, as by Ctrl-Z; `fg` in its terminal or `kill -CONT 4711`"
        " continues it, `taskrpc stop 4711` ends it"
    )


async def test_silent_process_that_is_not_stopped_is_not_called_stopped(monkeypatch):
    monkeypatch.setattr("taskrpc.core.system.process_state.is_stopped", lambda _: False)
    assert str(await failure(HERE)) == f"{PLACE}: it did not respond"


async def test_a_plain_connection_that_is_lost_in_the_handshake_suggests_tls():
    text = str(await failure(PEER, ConnectionLost(HANDSHAKE_LOST)))
    assert text.startswith(
        f"{PLACE}: the connection was lost in the handshake; if the server requires TLS"
    )
    assert "--tls-ca" in text
    assert "tls=taskrpc.Tls(ca=...)" in text


async def test_an_encrypted_connection_that_is_lost_does_not_suggest_tls(monkeypatch):
    monkeypatch.setattr(Plain, "get_extra_info", lambda *_: object())
    text = str(await failure(PEER, ConnectionLost(HANDSHAKE_LOST)))
    assert text == f"{PLACE}: the connection was lost in the handshake"


async def test_revoked_account_of_a_lab_gets_the_hint_to_ask_for_a_new_string():
    found = await failure(LAB, AuthenticationFailed("the token is not this server's"))
    said = f"the lab's server at {PLACE} refuses the account ana.k: the token is not this server's"
    assert (type(found), str(found)) == (AuthenticationFailed, said)
    assert found.__notes__ == [
        "the account was revoked or has expired: ask for a new join string",
    ]


async def test_error_does_not_show_a_token():
    found = await failure(PEER, AuthenticationFailed("the token is not this server's"))
    assert str(found) == f"{PLACE}: the token is not this server's"


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (ConnectionRefusedError(errno.ECONNREFUSED, "x"), "Connection refused"),
        (TimeoutError(), "it did not respond"),
        (UnicodeError(), "not a valid host name"),
    ],
)
async def test_error_names_the_place_once_and_a_lab_as_the_lab(error, reason):
    assert str(await failure(PEER, in_dialling=error)) == f"{PLACE}: {reason}"
    text = str(await failure(LAB, in_dialling=error))
    assert text.startswith(f"the lab's server at {PLACE}: {reason}; is it on, and is this")
    assert text.endswith("`taskrpc join --leave` forgets the lab")


async def test_protocol_error_in_the_handshake_stays_a_protocol_error():
    found = await failure(PEER, ProtocolError("expected TRPC"))
    assert (type(found), str(found)) == (ProtocolError, "expected TRPC")


@pytest.mark.real_time
async def test_log_names_an_unreachable_lab_once(caplog):
    off = "127.0.0.1:1"
    lab.remember_lab(lab.Lab(address=off, token="ada.secret", certificate=""))
    async with taskrpc.Node("laptop") as node:
        with caplog.at_level(logging.WARNING):
            assert [each.nodes for each in await node.graph()] == [("/laptop",)]
        (record,) = caplog.records
        assert record.getMessage().count(off) == 1
        client = node.create_client(Add, "/add", timeout=1)
        with pytest.raises(taskrpc.ServiceUnavailable, match="the lab's server at 127") as caught:
            await client.call(ask())
        assert str(caught.value).count(off) == 1
