"""The talker, the listener and the service programs that the ROS tutorials start.

`taskrpc run demo_nodes_py talker` runs `topics.talker`; the others are run alike. Topics, services,
names of nodes and printed lines are those of ROS. Larger examples are in `examples`.
"""
