"""The engine for ROS 2: taskrpc programs and ROS programs on one graph, over the real rclpy.

Start with `ros_engine`. Two taskrpc programs exchange the tunnel's datagrams over hidden topics
(`program_links`). ROS programs see the services and topics themselves (`native_services`,
`native_topics`).
`definitions` and `conversion` are pure: ROS's generated classes and ours.
"""
