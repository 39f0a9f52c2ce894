"""Parameters of nodes: declared, checked, set and listed.

Start with `node_parameters`, which every node owns; the other modules serve it. The class
`Parameter` and the services for other programs are in `rclpy.parameter` and
`rclpy.parameter_service`.
"""
