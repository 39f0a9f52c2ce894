"""The network of real processes: TCP and Unix sockets.

Start with `tcp_network`. `listening` accepts connections, `timeouts` tells TCP when to give up on
a silent peer. What travels over a connection is in `transport.connection`."""
