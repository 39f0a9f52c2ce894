"""`taskrpc router`: a Zenoh router, to which programs connect.

Start with `command_line`. Zenoh's own library does the routing; the command only starts it, and
says where it listens.
"""
