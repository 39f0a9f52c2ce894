"""`taskrpc task`: the queue of a task server, from a command line.

Start with `command_line`; `task_services` calls the server, `view` prints tasks."""
