"""`taskrpc task`: submits tasks to the task server, follows and changes them.

Start with `command_line`. `task_services` calls the server, `view` turns tasks into text and JSON,
`progress` shows their progress. The queue itself is in `taskrpc.robot.tasks`.
"""
