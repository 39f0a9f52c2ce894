"""The join string: one line with everything that a laptop needs to call a lab, and a checksum."""

from __future__ import annotations

import base64
import binascii
import string
from typing import Annotated

import msgspec
from msgspec import Meta

from taskrpc.errors import TaskRpcError

PREFIX = "taskrpc-join1."
_FAMILY = "taskrpc-join"
_ALPHABET = string.ascii_letters + string.digits + "-_"
_CHECKSUM = 4  # bytes
_LONGEST = 8192
"""Characters; more than the longest fields need."""
_LONGEST_TO_MEND = 1000
"""Characters; in longer strings no mistyped one is searched. Searching 1000 takes about a second;
most strings have 200."""


# Anybody can make a join string, and a laptop prints, calls and stores its fields: check them.
_Address = Annotated[
    str,
    Meta(
        max_length=300,
        pattern=r"^([A-Za-z0-9]([A-Za-z0-9.-]*[A-Za-z0-9])?"
        r"|\[[0-9A-Fa-f:.]+(%[A-Za-z0-9_.-]+)?\]):[0-9]{1,5}\Z",
    ),
]
_Token = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_.@+-]{1,64}\.[A-Za-z0-9_~=+/-]{1,256}\Z")]
_Namespace = Annotated[
    str, Meta(max_length=90, pattern=r"^/([A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)?)?\Z")
]
_LATEST = 32_503_680_000
"""The year 3000: some systems know no later time."""


class Invitation(msgspec.Struct, array_like=True, frozen=True):
    """The contents of a join string."""

    addresses: Annotated[tuple[_Address, ...], Meta(min_length=1, max_length=16)]
    """`HOST:PORT`, the most probable one first."""
    fingerprint: Annotated[bytes, Meta(min_length=32, max_length=32)]
    """SHA-256 of the server's certificate (DER)."""
    token: _Token
    """`NAME.SECRET`."""
    namespace: _Namespace
    """The namespace of the student's own nodes."""
    expires: Annotated[int, Meta(ge=0, le=_LATEST)]
    """When the string expires, in seconds since 1970; 0 for never."""
    domain: Annotated[int, Meta(ge=0, le=232)]
    """The server's `ROS_DOMAIN_ID`."""

    def __repr__(self) -> str:
        # Without the token, because printed texts end up in logs.
        return f"Invitation({', '.join(self.addresses)}, {self.namespace})"


def to_join_string(invitation: Invitation) -> str:
    """Return the join string of an invitation."""
    body = msgspec.msgpack.encode(invitation)
    return PREFIX + base64.urlsafe_b64encode(_checksum(body) + body).decode().rstrip("=")


def from_join_string(text: str) -> Invitation:
    """Return the contents of a join string; spaces and line breaks in it are ignored.

    Raises TaskRpcError for an invalid string; the text gives the place of a mistyped character.
    """
    if len(text) > _LONGEST:
        problem = f"expected a join string of at most {_LONGEST} characters, got {len(text)}"
        raise TaskRpcError(problem)
    joined = "".join(text.split())
    if not joined.startswith(PREFIX):
        raise TaskRpcError(_foreign(joined))
    letters = joined.removeprefix(PREFIX)
    for index, letter in enumerate(letters, len(PREFIX) + 1):
        if letter not in _ALPHABET:
            raise TaskRpcError(
                f"the join string has {letter!r} at position {index}, which is never valid"
            )
    body = _body(letters)
    if body is None:
        raise TaskRpcError(_damage(letters))
    try:
        return msgspec.msgpack.decode(body, type=Invitation)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise TaskRpcError(f"expected a join string of this version: {error}") from None


def _foreign(joined: str) -> str:
    if joined.startswith(_FAMILY):
        version = joined.partition(".")[0][:20]
        return f"expected a join string that begins with {PREFIX}, got {version}: another version"
    # Show no more of the text: it may contain a secret.
    return f"expected a join string, which begins with {PREFIX}, got {joined[:8]!r}…"


def _damage(letters: str) -> str:
    """Describe a string with a wrong checksum; names a single mistyped character."""
    for index, letter in enumerate(letters if len(letters) <= _LONGEST_TO_MEND else ""):
        before, after = letters[:index], letters[index + 1 :]
        if any(_body(before + other + after) is not None for other in _ALPHABET):
            position = len(PREFIX) + index + 1
            return f"the join string is mistyped: the character at position {position}, {letter!r}"
    return "the join string is incomplete, or several characters are wrong: copy it whole"


def _body(letters: str) -> bytes | None:
    """Return the data after the checksum; None if the checksum is wrong."""
    try:
        data = base64.urlsafe_b64decode(letters + "=" * (-len(letters) % 4))
    except binascii.Error:
        return None
    checksum, body = data[:_CHECKSUM], data[_CHECKSUM:]
    return body if body and checksum == _checksum(body) else None


def _checksum(body: bytes) -> bytes:
    return binascii.crc32(body).to_bytes(_CHECKSUM, "big")
