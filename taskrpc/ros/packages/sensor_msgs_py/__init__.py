"""Point clouds as NumPy arrays, with the functions of ROS's `sensor_msgs_py`.

All functions are in `point_cloud2`, as in ROS. They need NumPy. Only programs import this package.
"""
