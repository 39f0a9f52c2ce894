"""turtlesim: the simulator of ROS's first tutorials, with its programs and its drawings.

`world` and `canvas` compute and are pure; `node` offers the world to ROS programs, and `teleop`
drives a turtle from the keyboard. `drawing` shows the picture.
"""
