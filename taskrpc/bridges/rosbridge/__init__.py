"""rosbridge v2: JSON over WebSocket, for browsers and other programs without taskrpc.

Start with `session`, which serves one client. `protocol` and `values` are pure: what a message
means, and messages as JSON. `services` and `topics` connect a client to the network, `rosapi`
answers its questions about the network. `server` accepts WebSocket connections; it is the only
module that imports aiohttp (the extra `web`). Pages and commands do not belong here.
"""
