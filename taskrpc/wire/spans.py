"""The caller's span before a request's body: W3C's trace context, in as few bytes as it has."""

from __future__ import annotations

from taskrpc.errors import ProtocolError
from taskrpc.wire.frames import Body

SPAN_SIZE = 25
"""Bytes: 16 of the trace's id, 8 of the span's, 1 of flags."""


def cut_span(body: Body) -> tuple[bytes, Body]:
    """The span and the rest of a body. Raises ProtocolError where it is too short for one."""
    if len(body) < SPAN_SIZE:
        raise ProtocolError("a traced request without its span")
    return bytes(body[:SPAN_SIZE]), body[SPAN_SIZE:]
