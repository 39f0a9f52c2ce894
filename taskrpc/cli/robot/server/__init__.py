"""`taskrpc-server`: the lecture's task server, with a simulated robot or the user's own robot.

Start with `command_line`. `monitoring` serves the pages of `--web`, and `fleet_server` has what
differs for a fleet. The task server itself is `taskrpc.robot.tasks.server`.
"""
