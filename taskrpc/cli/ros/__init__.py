"""The verbs that `ros2` has too, under ROS's names.

Each module or folder is one verb, and accepts the lines of ROS tutorials that use the verb. Start
with `node`, which is short. Verbs that `ros2` does not have are not here, also if they handle ROS
packages: they are in `workspace`.
"""
