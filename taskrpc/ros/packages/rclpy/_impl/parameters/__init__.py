"""Parameters of nodes: declared, checked, set and listed.

Start with `node_parameters`, which every node owns; `node_methods` are the methods of `Node` that
call it, and the other modules serve it. The class
`Parameter` and the services for other programs are in `rclpy.parameter` and
`rclpy.parameter_service`.
"""
