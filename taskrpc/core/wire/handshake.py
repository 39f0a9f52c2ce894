"""The start of a connection: versions, domain, and proof of the token from both sides.

    client                              server
    TRPC, HELLO(nonce, account) ─▶
                                ◀─      HELLO_ACK(nonce)
    AUTH(proof)                 ─▶
                                ◀─      AUTH_OK(proof)

A proof is an HMAC over both nonces and the prover's role. So it can neither be replayed nor sent
back to the other side. It also covers the server's certificate (channel binding). So an attacker
cannot forward it to another server, or from a plain connection to an encrypted one.

The server knows its own token and those of its accounts. The token that the caller proves to know
identifies the caller.

The connection itself may already identify the peer: by a certificate, or because the system knows
the user of the peer's process. Then the caller may prove the empty token instead.
"""

from __future__ import annotations

import hashlib
import hmac
from typing import NamedTuple

import msgspec

from taskrpc.core.security.roles import Account, Accounts, account_of
from taskrpc.core.wire import messages, status
from taskrpc.core.wire.frames import MAGIC, Frame, FrameType, pack_frame
from taskrpc.core.wire.messages import DEFAULT_LIMITS, VERSION, Hello, HelloAck, Limits
from taskrpc.errors import AuthenticationFailed, ProtocolError, TaskRpcError

_REFUSED = "the token is not this server's"
"""The whole text that a refused caller gets: it must not reveal whether an account exists."""


class PeerCredentials(msgspec.Struct, frozen=True):
    """What the connection itself proves about the peer, before the handshake."""

    name: str
    """The common name in the peer's certificate."""
    is_owner: bool = False
    """Whether the system has identified the peer as a program of this user (or root)."""


class Identity(msgspec.Struct, frozen=True):
    """The data of one side for a handshake. Ids and nonce are 16 random bytes each."""

    id: bytes
    """The client id, or the server's boot id."""
    nonce: bytes
    """New for every connection."""
    token: bytes
    """The secret that this side proves to know; for a client with an account, the account's."""
    domain: int = 0
    name: str = ""
    """The caller's node or program; servers need none."""
    limits: Limits = DEFAULT_LIMITS
    """What this side accepts as a server; a client always accepts the defaults."""
    accounts: Accounts | None = None
    """The server's accounts; None without accounts."""
    today: float = 0.0
    """The present time in seconds since 1970; the server compares it with expiry times."""

    def __repr__(self) -> str:
        # Without the token: it must not appear in logs.
        return (
            f"Identity(id={self.id!r}, nonce={self.nonce!r}, domain={self.domain},"
            f" name={self.name!r}, limits={self.limits!r})"
        )


class Peer(msgspec.Struct, frozen=True):
    """What one side knows about the other once the handshake is done."""

    id: bytes
    name: str
    limits: Limits
    """What the other side accepts; for a client always the defaults."""
    account: Account | None = None
    """The client's account; None if it proved the server's own token."""


class ClientHandshake:
    """The client's side of the handshake."""

    def __init__(self, me: Identity) -> None:
        self._me = me
        self._ack: HelloAck | None = None
        self.channel_binding = b""
        """A value that only the two ends of this connection share; b"" for a plain one."""
        self.peer_credentials: PeerCredentials | None = None
        """What the connection itself proves about the peer."""
        self.peer: Peer | None = None
        """Set once the handshake is done."""

    def start(self) -> bytes:
        """Return the first bytes of the connection."""
        me = self._me
        account = account_of(me.token)
        hello = Hello(VERSION, VERSION, me.id, me.nonce, me.domain, me.name, account)
        return MAGIC + pack_frame(FrameType.HELLO, 0, 0, 0, 0, messages.encode(hello))

    def receive(self, frame: Frame) -> bytes:
        """Handle the server's next frame; return the bytes to send. The last one sets `peer`.

        Raises AuthenticationFailed, ProtocolError, or the error that the server sent.
        """
        type_, flags, _, _, arg, body = frame
        if type_ == FrameType.ERROR:
            raise status.from_wire(arg >> 16, flags, arg & 0xFFFF, body)
        if type_ == FrameType.HELLO_ACK and self._ack is None:
            return self._prove(messages.decode_hello_ack(body))
        if type_ == FrameType.AUTH_OK and self._ack is not None:
            return self._accept(messages.decode_auth(body), self._ack)
        raise ProtocolError(f"expected the server's handshake, got frame type {type_}")

    def _prove(self, ack: HelloAck) -> bytes:
        if not self._me.token and self.peer_credentials is None:
            # Any program can prove the empty token, so the server could be an attacker's.
            raise AuthenticationFailed("its secret is needed (token, TASKRPC_TOKEN)")
        if ack.version != VERSION:
            raise ProtocolError(f"the server speaks version {ack.version}; this is {VERSION}")
        self._ack = ack
        proof = self._proof(b"client", ack)
        return pack_frame(FrameType.AUTH, 0, 0, 0, 0, messages.encode(messages.Auth(proof)))

    def _accept(self, auth: messages.Auth, ack: HelloAck) -> bytes:
        expected = self._proof(b"server", ack)
        if not hmac.compare_digest(auth.proof, expected):
            raise AuthenticationFailed("the server could not prove that it knows the token")
        self.peer = Peer(ack.boot_id, "", ack.limits)
        return b""

    def _proof(self, role: bytes, ack: HelloAck) -> bytes:
        return _proof(self._me.token, role, self._me.nonce, ack.nonce, self.channel_binding)


class _Key(NamedTuple):
    """A token that a caller may prove, and the account that it belongs to."""

    token: bytes
    account: Account | None = None
    """None for the server's own token, which allows everything."""

    def __repr__(self) -> str:
        return f"_Key({self.account!r})"  # without the token: it must not appear in logs


class ServerHandshake:
    """The server's side of the handshake."""

    def __init__(self, me: Identity) -> None:
        self._me = me
        self._own = _Key(me.token)
        self._hello: Hello | None = None
        self.channel_binding = b""
        """A value that only the two ends of this connection share; b"" for a plain one."""
        self.peer_credentials: PeerCredentials | None = None
        """What the connection itself proves about the peer."""
        self.peer: Peer | None = None
        """Set once the handshake is done."""

    def receive(self, frame: Frame) -> bytes:
        """Handle the client's next frame; return the bytes to send. The last one sets `peer`.

        Raises AuthenticationFailed or ProtocolError; send `refusal(error)` to the client then.
        """
        type_, body = frame[0], frame[5]
        if type_ == FrameType.HELLO and self._hello is None:
            return self._greet(messages.decode_hello(body))
        if type_ == FrameType.AUTH and self._hello is not None:
            return self._accept(messages.decode_auth(body), self._hello)
        raise ProtocolError(f"expected the client's handshake, got frame type {type_}")

    def _greet(self, hello: Hello) -> bytes:
        me = self._me
        if not hello.lowest <= VERSION <= hello.highest:
            raise ProtocolError(
                f"this server speaks version {VERSION},"
                f" the client {hello.lowest} to {hello.highest}"
            )
        if hello.domain != me.domain:
            raise ProtocolError(
                f"this server is in domain {me.domain}, the client in domain {hello.domain}"
                " (ROS_DOMAIN_ID)"
            )
        self._hello = hello
        ack = HelloAck(VERSION, me.id, me.nonce, me.limits)
        return pack_frame(FrameType.HELLO_ACK, 0, 0, 0, 0, messages.encode(ack))

    def _accept(self, auth: messages.Auth, hello: Hello) -> bytes:
        me = self._me
        key, why = self._key_of(hello.account)
        if not self._proves(auth, hello, key.token):
            key = self._key_by_credentials(auth, hello, why)
        self.peer = Peer(hello.client_id, hello.name, DEFAULT_LIMITS, key.account)
        proof = _proof(key.token, b"server", hello.nonce, me.nonce, self.channel_binding)
        return pack_frame(FrameType.AUTH_OK, 0, 0, 0, 0, messages.encode(messages.Auth(proof)))

    def _key_of(self, name: str) -> tuple[_Key, str]:
        """Return the key of an account, and the reason for the log if the caller cannot prove it.

        "" is the server's own token.
        """
        accounts = self._me.accounts
        if not name or accounts is None:
            return self._own, "it does not know this server's token"
        account = accounts.find(name, self._me.today)
        if account is None:
            # A proof is checked in any case, so that the time reveals nothing. It may even be
            # valid: a server's own token can look like that of an account, with a dot in it.
            return self._own, accounts.refusal(name, self._me.today)
        why = f"it does not know the secret of the account {name}"
        return _Key(account.token.encode(), account), why

    def _key_by_credentials(self, auth: messages.Auth, hello: Hello, why: str) -> _Key:
        """Return the key of a caller that the connection itself identifies.

        Raises AuthenticationFailed for any other caller without a valid proof.
        """
        accounts, credentials = self._me.accounts, self.peer_credentials
        if credentials is None or not self._proves(auth, hello, b""):
            raise _refused(why)
        if credentials.is_owner or accounts is None:
            return _Key(b"")
        account = accounts.find(credentials.name, self._me.today)
        if account is None:
            raise _refused(
                f"by its certificate {accounts.refusal(credentials.name, self._me.today)}"
            )
        return _Key(b"", account)

    def _proves(self, auth: messages.Auth, hello: Hello, token: bytes) -> bool:
        expected = _proof(token, b"client", hello.nonce, self._me.nonce, self.channel_binding)
        return hmac.compare_digest(auth.proof, expected)


def refusal(error: TaskRpcError) -> bytes:
    """Return the ERROR frame with the reason why the connection is closed."""
    wire = status.to_wire(error)
    arg = wire.code << 16 | wire.retry_after
    return pack_frame(FrameType.ERROR, wire.flags, 0, 0, arg, wire.body)


def _refused(why: str) -> AuthenticationFailed:
    """Return the same error for every caller; only this server's log gets the reason."""
    error = AuthenticationFailed(_REFUSED)
    error.add_note(why)
    return error


def _proof(
    token: bytes, role: bytes, client_nonce: bytes, server_nonce: bytes, channel_binding: bytes
) -> bytes:
    said = b"taskrpc " + role + client_nonce + server_nonce + channel_binding
    return hmac.digest(token, said, hashlib.sha256)
