"""What stands behind rclpy's loggers, under the names by which programs find it."""
