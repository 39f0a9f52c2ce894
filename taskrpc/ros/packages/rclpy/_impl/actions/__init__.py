"""What action clients and servers of rclpy consist of.

Start with `server_parts`: the services and publishers of an action server. The states of goals
belong to `taskrpc.actions`.
"""
