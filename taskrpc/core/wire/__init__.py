"""The TCP transport's protocol as pure state machines: bytes in, bytes and events out.

Start with `session`, one end of a connection; `frames` cuts the byte stream and `handshake` proves
who the peer is. Nothing here knows a clock, a socket or a thread:
`taskrpc.core.transport.connection` moves the bytes.
"""
