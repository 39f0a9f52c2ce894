"""Transports over middlewares: software that carries messages between programs.

`ros` is the engine for ROS 2 on the real rclpy, `zenoh` the one for Zenoh. An engine carries
datagrams and knows nothing of calls: the tunnel in `taskrpc.core.transport` makes connections out
of them. A transport over plain byte streams, such as TCP, is not here but in the core.
"""
