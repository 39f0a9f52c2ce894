"""The types of message fields, under the name of ROS's `rosidl_parser`.

Programs import them from `definition`, as in ROS. Nothing here parses definitions: that is the task
of `srvgen.definitions`.
"""
