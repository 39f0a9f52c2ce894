"""The command lines of the robot's task server.

`server` is `taskrpc-server`, `task` is the client of its services, and `demo` shows both in one
process. Start with `task.task_services`, which makes the calls. The queue and the robot themselves
are in `taskrpc.robot`.
"""
