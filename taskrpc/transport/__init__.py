"""How calls and messages travel between processes.

Start with `base`, the interface between nodes and any transport; `endpoint` implements it over
connections, and `shared_endpoint` gives the nodes of an event loop one endpoint. The folders hold
one idea each: `discovery`, `limits`, `connection`, `pubsub`, `tcp`. The bytes of the protocol are
in `taskrpc.wire`; handlers, queues and retries lie above this package.
"""
