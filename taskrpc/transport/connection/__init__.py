"""One connection: a session of `taskrpc.wire` on an asyncio transport.

Start with `connection`, the part that both ends share; then `client_side` and `server_side`.
Threads other than the event loop's come in through `client_threads` and `server_threads`."""
