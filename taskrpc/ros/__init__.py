"""The ways in for ROS 2 programs: `import rclpy` and interface packages, without ROS."""
