"""The network of real processes: TCP and Unix sockets.

Start with `tcp_network`, which finds and dials processes; `listening` accepts connections. The
bytes on a connection are the business of `transport.connection`, and dead peers are found by
`transport.limits.keepalive`.
"""
