"""`taskrpc router`: a router of Zenoh, at which programs meet.

Start with `command_line`. Zenoh's own library does the routing; the command only starts it, and
says where it listens.
"""
