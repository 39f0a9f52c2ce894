"""`taskrpc demo`: a server, three clients and a robot in one process, drawn on the terminal.

Start with `command_line`; `story` is what happens, `screen` draws it."""
