"""How calls and messages travel between processes.

Start with `endpoint`, which nodes use; `base` is what they pass to each other, and
`shared_endpoint` is the list of the transports. A transport implements `network`, or over a
middleware `engine`. The folders hold one idea each: `discovery`, `limits`, `connection`, `pubsub`,
`tcp`, `tunnel`. The bytes of the protocol are in `taskrpc.core.wire`; handlers, queues and retries
lie above this package.
"""
