"""`taskrpc top`: nodes, services, calls, queue and robot, live in the terminal.

Start reading with `command_line`. `reading` asks the programs, `model` computes rates from their
counts, `picture` arranges text (both pure), and `screen` draws it. Nothing here changes a program.
"""
