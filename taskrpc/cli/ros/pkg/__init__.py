"""`taskrpc pkg`: finds and creates packages, as `ros2 pkg` does.

Start with `command_line`; `create` writes a new package. `taskrpc.ros.colcon` determines the
contents of its files.
"""
