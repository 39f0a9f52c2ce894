"""`taskrpc topic`: list, info, type, find, echo, pub, hz, bw and delay, as `ros2 topic` does.

Start with `command_line`, which names the module of each verb. `pub` publishes, `reading`
subscribes, `topic_graph` finds topics. `shared.messages` makes the messages of `pub`.
"""
