"""Messages as CDR, the encoding of ROS 2, with the errors of `core.transport.codec`. Pure."""

from __future__ import annotations

from typing import Any

import srvgen
from taskrpc.core.transport.codec import invalid_value, wrong_class
from taskrpc.core.wire.frames import Body
from taskrpc.errors import InvalidRequest


def encode(cls: Any, message: Any) -> bytes:
    """Return a message of this class as CDR. Raises InvalidRequest."""
    # A message with checked fields has a class of its own, made from the original.
    if message.__class__ is not cls and getattr(message, "_ORIGINAL", None) is not cls:
        raise wrong_class(cls, message)
    try:
        return srvgen.to_cdr(message)
    except ValueError as error:
        raise invalid_value(error) from None


def decode(cls: Any, body: Body) -> Any:
    """Return the message of this class in a body. Raises InvalidRequest."""
    try:
        return srvgen.from_cdr(cls, body)
    except srvgen.CdrError as error:
        raise InvalidRequest("", f"this is not a {cls._TYPE} in CDR: {error}") from None
