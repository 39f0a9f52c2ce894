"""Publishes the frames of a robot from its description: ROS's package `robot_state_publisher`.

`urdf` reads a robot description (URDF) without any node; `kinematics` computes the transforms of
the joints and decides when to send them. `robot_state_publisher` is the node. ROS has it in C++.
"""
