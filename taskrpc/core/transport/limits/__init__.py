"""Bounds that keep one peer from taking what all peers need.

Start with `quotas`, the rule of fair shares. `admission`, `calls_in_flight` and `backpressure`
apply it to connections, calls and unread responses; `keepalive` finds dead peers. Nothing here
imports connections: each module names what it needs from one in a Protocol.
"""
