"""`taskrpc param`: the parameters of nodes, as `ros2 param` has them.

Start with `command_line`; `param_services` calls a node's parameter services."""
