"""The logger classes, under the names by which programs import them from rclpy.

Start with `rcutils_logger`. The levels, filters, formats and outputs of the log are in
`_impl.log`; only files that ROS names belong here.
"""
