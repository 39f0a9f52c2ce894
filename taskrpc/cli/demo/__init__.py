"""`taskrpc demo`: a task server, three clients and a robot in one process, on screen.

Start with `command_line`; `story` runs the programs, `screen` and `map_view` draw, `accounts`
keeps what is drawn. Nothing here touches the network or the disk.
"""
