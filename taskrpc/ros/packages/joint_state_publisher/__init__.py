"""Publishes positions of a robot's joints: ROS's package `joint_state_publisher`.

`joints` keeps the states of the joints without any node; `joint_state_publisher` is the node. The
robot description is read by `robot_state_publisher.urdf`.
"""
