"""`taskrpc bridge`: gateways to programs that do not use taskrpc, and to robots with ROS 2.

Start reading with `command_line`, which has the gateway for rosbridge. `robot` is the gateway
between a robot and laptops, and `mcp` the bridge for agents.
"""
