"""`taskrpc demo`: a task server, three clients and a robot in one process, on screen.

Start with `command_line`. `story` runs the programs, `screen` and `map_view` draw them, `estimates`
checks the estimates at the end. Nothing here uses the network or the disk.
"""
