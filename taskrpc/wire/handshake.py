"""The start of a connection: versions, domain, and proof of the token from both sides.

    client                              server
    TRPC, HELLO(nonce, account) ─▶
                                ◀─      HELLO_ACK(nonce)
    AUTH(proof)                 ─▶
                                ◀─      AUTH_OK(proof)

A proof is an HMAC over both nonces and the prover's role, so that it can neither be replayed nor
sent back to the one who asked for it; and over the certificate that the server showed, so that
nobody can pass it on to another server, or from a plain connection to an encrypted one.

The server knows a token of its own and those of its accounts; which of them the caller proves to
know says who he is.

Where the connection itself has proved the peer, by a certificate or since the system says which
user it belongs to, the empty token may be proved instead.
"""

from __future__ import annotations

import hashlib
import hmac
from typing import NamedTuple

import msgspec

from taskrpc.errors import AuthenticationFailed, ProtocolError, TaskRpcError
from taskrpc.security.roles import Account, Accounts, account_of
from taskrpc.wire import messages, status
from taskrpc.wire.frames import MAGIC, Frame, FrameType, pack_frame
from taskrpc.wire.messages import DEFAULT_LIMITS, VERSION, Hello, HelloAck, Limits

_REFUSED = "the token is not this server's"
"""All that a refused caller learns: not whether there is such an account, nor what became of it."""


class PeerCredentials(msgspec.Struct, frozen=True):
    """What the connection proves of the other side before anything is said on it."""

    name: str
    """Whom its certificate names."""
    is_owner: bool = False
    """Whether it is no certificate, but the system: the peer is a program of this user."""


class Identity(msgspec.Struct, frozen=True):
    """What one side brings to a handshake. Ids and nonce are 16 random bytes each."""

    id: bytes
    """The client id, or the server's boot id."""
    nonce: bytes
    """Fresh for every connection."""
    token: bytes
    domain: int = 0
    name: str = ""
    limits: Limits = DEFAULT_LIMITS
    """What this side accepts as a server; a client always accepts the defaults."""
    accounts: Accounts | None = None
    """A server's, where it has any."""
    today: float = 0.0
    """Seconds since 1970, when a server looks whether an account has expired."""

    def __repr__(self) -> str:
        # Without the token: what is printed ends in logs.
        return (
            f"Identity(id={self.id!r}, nonce={self.nonce!r}, domain={self.domain},"
            f" name={self.name!r}, limits={self.limits!r})"
        )


class Peer(msgspec.Struct, frozen=True):
    """What is known of the other side once the handshake is done."""

    id: bytes
    name: str
    limits: Limits
    """What the other side accepts (a server's view of a client has the defaults)."""
    account: Account | None = None
    """What a client proved to have, None where it proved the server's own token."""


class ClientHandshake:
    """The calling side."""

    def __init__(self, me: Identity) -> None:
        self._me = me
        self._ack: HelloAck | None = None
        self.channel_binding = b""
        """What both ends know of the connection itself."""
        self.peer_credentials: PeerCredentials | None = None
        self.peer: Peer | None = None

    def start(self) -> bytes:
        """The first bytes of the connection."""
        me = self._me
        account = account_of(me.token)
        hello = Hello(VERSION, VERSION, me.id, me.nonce, me.domain, me.name, account)
        return MAGIC + pack_frame(FrameType.HELLO, 0, 0, 0, 0, messages.encode(hello))

    def receive(self, frame: Frame) -> bytes:
        """Take the server's next frame; returns what to send. `peer` is set once it is done.

        Raises AuthenticationFailed, ProtocolError, or whatever error the server answered.
        """
        type_, flags, _, _, arg, body = frame
        if type_ == FrameType.ERROR:
            raise status.from_wire(arg >> 16, flags, arg & 0xFFFF, body)
        if type_ == FrameType.HELLO_ACK and self._ack is None:
            return self._prove(messages.decode_hello_ack(body))
        if type_ == FrameType.AUTH_OK and self._ack is not None:
            return self._accept(messages.decode_auth(body), self._ack)
        raise ProtocolError(f"frame type {type_} came where the server's handshake was expected")

    def _prove(self, ack: HelloAck) -> bytes:
        if not self._me.token and self.peer_credentials is None:
            # Whoever listens there knows the empty token too, and would be given our requests.
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
    """What a caller must know, and what it opens."""

    token: bytes
    account: Account | None = None
    """None for everything."""

    def __repr__(self) -> str:
        return f"_Key({self.account!r})"  # without the token: what is printed ends in logs


class ServerHandshake:
    """The called side."""

    def __init__(self, me: Identity) -> None:
        self._me = me
        self._own = _Key(me.token)
        self._hello: Hello | None = None
        self.channel_binding = b""
        """What both ends know of the connection itself."""
        self.peer_credentials: PeerCredentials | None = None
        self.peer: Peer | None = None

    def receive(self, frame: Frame) -> bytes:
        """Take the client's next frame; returns what to send. `peer` is set once it is done.

        Raises AuthenticationFailed or ProtocolError; tell the client with `refusal(error)`.
        """
        type_, body = frame[0], frame[5]
        if type_ == FrameType.HELLO and self._hello is None:
            return self._greet(messages.decode_hello(body))
        if type_ == FrameType.AUTH and self._hello is not None:
            return self._accept(messages.decode_auth(body), self._hello)
        raise ProtocolError(f"frame type {type_} came where the client's handshake was expected")

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
        """What a caller of this account must know, and what is wrong if he does not."""
        accounts = self._me.accounts
        if not name or accounts is None:
            return self._own, "it does not know this server's token"
        account = accounts.find(name, self._me.today)
        if account is None:
            # Compared with a token all the same, so that the time tells nothing; and it may be
            # this server's own, with a dot in it.
            return self._own, accounts.refusal(name, self._me.today)
        why = f"it does not know the secret of the account {name}"
        return _Key(account.token.encode(), account), why

    def _key_by_credentials(self, auth: messages.Auth, hello: Hello, why: str) -> _Key:
        """What a caller may do who proved no token. Raises AuthenticationFailed."""
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
    """The ERROR frame that tells a peer why its connection is closed."""
    wire = status.to_wire(error)
    arg = wire.code << 16 | wire.retry_after
    return pack_frame(FrameType.ERROR, wire.flags, 0, 0, arg, wire.body)


def _refused(why: str) -> AuthenticationFailed:
    """The same for every caller; the note is for our own log."""
    error = AuthenticationFailed(_REFUSED)
    error.add_note(why)
    return error


def _proof(
    token: bytes, role: bytes, client_nonce: bytes, server_nonce: bytes, channel_binding: bytes
) -> bytes:
    said = b"taskrpc " + role + client_nonce + server_nonce + channel_binding
    return hmac.digest(token, said, hashlib.sha256)
