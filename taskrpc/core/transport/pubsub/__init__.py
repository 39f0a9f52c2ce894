"""Topics over connections: publishers that feed subscriptions of other processes.

Start with `endpoint_topics`, which knows both; `publishing` sends, `subscribing` receives. The API
that programs use is `taskrpc.topic`, and the frames are in `taskrpc.core.wire.topics`.
"""
