"""Nodes, topics and services by the names of ROS, and their quality of service.

Start with `node_graph`, which answers the questions that programs ask a node; `endpoints` builds
its entries. Nothing here runs callbacks.
"""
