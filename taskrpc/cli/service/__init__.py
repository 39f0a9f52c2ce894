"""`taskrpc service`: call, echo, find, info, list and type, as `ros2 service` does.

Start with `command_line`; `calling` makes the calls of `taskrpc-call` too, and `echo` prints
introspection events. Requests are read in `shared.values`.
"""
