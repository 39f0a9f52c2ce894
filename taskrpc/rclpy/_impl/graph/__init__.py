"""Nodes, topics and services by ROS's names, and which QoS fits which. Start with `node_graph`."""
