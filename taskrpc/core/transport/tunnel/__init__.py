"""Connections between taskrpc programs over the datagrams of a middleware's engine.

Start with `tunnel_network`, which implements `Network` over an `Engine`. The decisions are pure:
`frames` is the format of a datagram, `stream` one end of a connection, `directory` the programs
that are there. `stream_transport` joins a stream with asyncio. `native` uses the middleware's own
services and topics, for foreign programs. `handoff` passes calls from an engine's threads to the
event loop, and `cdr` encodes native messages. No module here knows a particular middleware.
"""
