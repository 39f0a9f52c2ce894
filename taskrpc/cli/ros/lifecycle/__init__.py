"""`taskrpc lifecycle`: read and change the states of lifecycle nodes, as `ros2 lifecycle` does.

Start with `command_line`; `lifecycle_services` calls the lifecycle services of a node. The states
and their transitions are in `taskrpc.ros.packages.rclpy`.
"""
