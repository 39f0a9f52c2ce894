"""One connection: a session of `taskrpc.core.wire` on an asyncio transport.

Start with `connection`, the part that both ends share; then `client_side` and `server_side`.
Threads other than the event loop's enter through `client_threads` and `server_threads`. Nothing
here knows topics, endpoints or sockets: those import this package and pass in what it needs.
"""
