"""`taskrpc bag`: records topics and services, describes recordings and plays them, as `ros2 bag`.

Start with `command_line`. The files themselves are read and written by `taskrpc.observe.recording`.
"""
