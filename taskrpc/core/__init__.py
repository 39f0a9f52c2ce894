"""What lies below the API of services, topics and actions: the part that no user imports.

Start with `transport`, which carries calls between processes, and `wire`, the protocol as pure
state machines. `exactly_once`, `execution` and `storage` run callbacks and keep what they did. The
core imports nothing of the districts around it; what they may use of it is in `taskrpc.spi`.
"""
