"""`taskrpc service`: call, echo, find, info, list and type, as `ros2 service` does.

Start with `command_line`. `calling` makes the calls, also those of `taskrpc-call`; `echo` prints
introspection events. `shared.values` reads the requests.
"""
