"""`taskrpc param`: read and set the parameters of nodes, as `ros2 param` does.

Start with `command_line`; `param_services` calls the parameter services of a node. Parameters
themselves are declared and kept in `taskrpc.ros.packages.rclpy`.
"""
