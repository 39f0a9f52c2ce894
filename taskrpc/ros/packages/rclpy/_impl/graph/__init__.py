"""Nodes, topics and services by the names of ROS, and their quality of service.

Start with `node_graph`, the methods of `Node` that read the graph; `endpoints` builds their
results. Nothing here runs callbacks.
"""
