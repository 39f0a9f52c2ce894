"""Python packages that ROS programs import, each in a folder with its name in ROS.

Programs import them under these names; the import hook finds them. A real package of the same name
takes precedence. `taskrpc.ros.bundled` lists what `taskrpc run PACKAGE EXECUTABLE` starts.
Definitions of messages are in `srvgen`.
"""
