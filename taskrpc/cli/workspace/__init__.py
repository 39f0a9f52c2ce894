"""Verbs for programs and packages on the disk, for your shell and for your Python.

Each module is one verb. `ros` and `shell` change the environment so that lines of ROS tutorials
work; `colcon` checks a workspace; `graduate` and `export` prepare programs for ROS 2. Start with
`export`, which is short. The work itself is done by `taskrpc.ros`.
"""
