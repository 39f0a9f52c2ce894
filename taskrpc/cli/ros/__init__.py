"""The verbs that `ros2` has too, under ROS's names and with ROS's options.

Each module or folder is one verb; the reference is the help page of the same verb of `ros2`. Start
with `node`, which is short. Verbs that `ros2` does not have are not here, also if they handle ROS
packages: they are in `workspace`.
"""
