"""`taskrpc task`: submit tasks to the task server, follow and change them.

Start with `command_line`; `task_services` calls the server, `view` turns tasks into text and
JSON, `progress` shows how they proceed. The queue itself is in `taskrpc.tasks`.
"""
