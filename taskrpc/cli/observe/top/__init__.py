"""`taskrpc top`: nodes, services, calls, queue and robot, live in the terminal.

Start reading with `command_line`. `picture` arranges text and is pure, and `screen` draws it. What
they show comes from `taskrpc.observe.top`. Nothing here changes a program.
"""
