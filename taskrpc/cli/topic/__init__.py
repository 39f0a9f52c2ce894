"""`taskrpc topic`: list, info, type, find, echo, pub, hz, bw and delay, as `ros2 topic` does.

Start with `command_line`, which names the module of each verb. `reading` subscribes, `messages`
makes the messages of `pub`, `topic_graph` finds topics. `taskrpc.topic` publishes and subscribes.
"""
