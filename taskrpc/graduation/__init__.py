"""What a program would do differently on a real ROS 2, found by reading it."""
