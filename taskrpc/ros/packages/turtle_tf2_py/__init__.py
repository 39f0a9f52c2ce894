"""The program `turtle_tf2_broadcaster` of ROS's `turtle_tf2_py`: it sends the frame of a turtle.

`taskrpc run turtle_tf2_py turtle_tf2_broadcaster --ros-args -p turtlename:=turtle1` starts it.
Other programs import `quaternion_from_euler` from the module of this program.
"""
