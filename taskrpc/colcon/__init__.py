"""Packages as colcon builds them on a robot with ROS 2: what `taskrpc pkg` and `export` write."""
