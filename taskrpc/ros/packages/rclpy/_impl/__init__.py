"""The private machinery of rclpy: no file here has a name of ROS.

Start with `node_interface` and `node_entities`, then `execution`, which runs callbacks.
`parameters` and `graph` belong to nodes, `diagnostics` warns about what ROS 2 does in silence, and
`bridge` is the only module that knows the background event loop. Names that programs import from
rclpy do not belong here.
"""
