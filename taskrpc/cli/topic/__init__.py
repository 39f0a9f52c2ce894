"""`taskrpc topic`: list, info, type, find, echo, pub, hz, bw and delay, as `ros2 topic` does.

Start with `command_line`, which names the module of each verb. `reading` subscribes, `messages`
makes what `pub` sends, `topic_graph` looks for topics. Publishing and subscribing themselves are
in `taskrpc.topic`.
"""
