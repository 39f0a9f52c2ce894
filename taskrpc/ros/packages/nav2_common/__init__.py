"""Parameter files that a launch file changes: ROS's package `nav2_common`.

Launch files import from `launch`. `rewriting` has what is done to the content of a file. Nothing of
Nav2 itself is here.
"""
