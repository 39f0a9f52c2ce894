"""The entrances for ROS 2 programs: `import rclpy` and interface packages without ROS.

Start reading in `hook`, which makes the imports work; `runner` is `taskrpc run`, `environment` is
`taskrpc ros enable`. `workspace`, `installed` and `cmake` read the packages of a workspace from
their sources. `packages` has other Python packages of ROS, which programs import by ROS's names.
One of them is `rclpy`. Code that writes packages is `taskrpc.ros.colcon`.
"""
