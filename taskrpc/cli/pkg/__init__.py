"""`taskrpc pkg`: find packages and create them, as `ros2 pkg` does.

Start with `command_line`; `create` writes a new package. What the files contain is decided in
`taskrpc.colcon`.
"""
