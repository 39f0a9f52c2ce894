"""Finds what a program or package would do differently on a real ROS 2 (`taskrpc graduate`).

Start reading in `check`, which reads the files and asks each rule for its findings. The rules are
in `blocking` (waiting for ever), `api_usage` (what rclpy rejects) and `package` (what colcon
misses); they see a program only through `program`. `comparison` runs a program with both systems.
Nothing here runs while a program runs: only the command line imports this package.
"""
