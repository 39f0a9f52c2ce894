"""Packages that colcon builds on a robot with ROS 2: `taskrpc pkg create` and `taskrpc export`.

Start reading in `export`, which turns a folder of programs and definitions into a workspace.
`manifest`, `cmake_package` and `python_package` produce the texts of the files and are pure; only
`writing` and `export` touch the disk. Reading existing packages belongs into `taskrpc.ros`, and
only the command line and `taskrpc.ros.graduation` import this package.
"""
