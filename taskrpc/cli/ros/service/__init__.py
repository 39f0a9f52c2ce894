"""`taskrpc service`: call, echo, find, info, list and type, as `ros2 service` does.

Start with `command_line`. `echo` prints introspection events. `shared.calling` makes the calls,
also those of `taskrpc-call`; `shared.values` reads the requests.
"""
