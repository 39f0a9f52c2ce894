"""`taskrpc pkg`: packages of a ROS workspace, as `ros2 pkg` has them.

Start with `command_line`; `create` writes a new package."""
